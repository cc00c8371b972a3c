"""Forty drawn worlds of colour, light and noise, filmed by the lab's camera: how often is an outcome wrong?"""
