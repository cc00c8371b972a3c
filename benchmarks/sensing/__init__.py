"""Trials filmed by the lab's camera under twelve conditions: how often is an outcome wrong?"""
