"""Sensor model of a time-of-flight RGB-D camera, applied to a perfect picture.

Order of magnitude from the maker's data sheet (systematic error under 11 mm + 0.1 % of the distance, random error
up to 17 mm) and from measurements on matte surfaces at 1 m (1 to 2 mm).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from sim.render.rays import Array32

NEAR_M, FAR_M = 0.35, 3.86
"""Range (m) of the narrow field of view, unbinned; no readings outside."""


@dataclass(frozen=True)
class SensorNoise:
    """The deviations of one camera from a perfect one. Lengths in m; every depth term is already scaled."""

    depth_std_m: float = 0.0015  # at 1 m on white at normal incidence; grows with distance squared and on dark surfaces
    depth_bias_m: float = 0.0015  # constant
    depth_gain: float = 1.001  # proportional to the distance
    ripple_m: float = 0.0005  # slow wave over the image, the residual of lens and phase correction
    edge_step_m: float = 0.012  # neighbours farther than this off a plane form an edge
    edge_hole_share: float = 0.45  # of the pixels at an edge: no reading
    edge_flying_share: float = 0.35  # of the pixels at an edge: a reading between the two surfaces
    colour_std: float = 1.6  # grey levels of 255
    lens_blur_px: float = 0.0  # standard deviation of the colour lens's point spread
    jpeg_quality: int | None = None  # of the colour stream; None: uncompressed

    @classmethod
    def draw(cls, rng: np.random.Generator, depth_noise_scale: float = 1.0) -> Self:
        """Draw one camera: bias, gain and ripple are individual and constant; scale 0 is a perfect sensor."""
        s = depth_noise_scale
        bias, gain, ripple = rng.uniform(-1, 1, 3)
        return cls(
            depth_std_m=0.0015 * s,
            depth_bias_m=0.003 * s * float(bias),
            depth_gain=1 + 0.001 * s * float(gain),
            ripple_m=0.0006 * s * float(ripple),
            edge_hole_share=0.45 * min(1.0, s),
            edge_flying_share=0.35 * min(1.0, s),
            colour_std=1.6 * min(1.0, s),
        )


def sense_depth(
    depth_m: Array32, cosine: Array32, albedo: Array32, noise: SensorNoise | None, rng: np.random.Generator
) -> NDArray[np.uint16]:
    """(H, W) true depth (inf: no hit), cosine of incidence and grey albedo -> depth in mm, 0 = no reading."""
    missing = ~((depth_m > NEAR_M) & (depth_m < FAR_M))
    z = np.where(missing, np.float32(0), depth_m)
    if noise is None:
        return np.round(1000 * z).astype(np.uint16)
    clean = z
    brightness = np.clip(albedo * cosine, 0.02, 1.0)
    std = noise.depth_std_m * clean**2 * np.sqrt(0.5 / brightness)
    z = clean * noise.depth_gain + noise.depth_bias_m + noise.ripple_m * _wave(*z.shape)
    z = z + std * rng.standard_normal(z.shape, dtype=np.float32)
    z, missing = _edges(clean, z, missing, noise, rng)
    missing |= (cosine < 0.10) | (albedo < 0.008)
    z[missing] = 0
    return np.clip(np.round(1000 * z), 0, 65535).astype(np.uint16)


@lru_cache
def _wave(height: int, width: int) -> Array32:
    """(H, W) -1 to 1, slowly varying."""
    v, u = np.arange(height, dtype=np.float32)[:, None] / height, np.arange(width, dtype=np.float32) / width
    wave: Array32 = np.sin(7.1 * u + 4.3 * v) * np.cos(5.3 * v - 2.1 * u)
    return wave


def _edges(
    clean: Array32, z: Array32, missing: NDArray[np.bool_], noise: SensorNoise, rng: np.random.Generator
) -> tuple[Array32, NDArray[np.bool_]]:
    """Add holes and flying pixels at edges between surfaces."""
    kernel = np.ones((3, 3), np.uint8)
    far, near = cv2.dilate(clean, kernel), cv2.erode(clean, kernel)
    rows, columns = np.nonzero((np.abs(far + near - 2 * clean) > noise.edge_step_m) & ~missing)
    fate, mix = rng.random((2, len(rows)), dtype=np.float32)
    hole = fate < noise.edge_hole_share
    flying = ~hole & (fate < noise.edge_hole_share + noise.edge_flying_share)
    missing = missing.copy()
    missing[rows[hole], columns[hole]] = True
    at = rows[flying], columns[flying]
    lowest = np.maximum(near[at], NEAR_M)
    z = z.copy()
    z[at] = lowest + mix[flying] * (far[at] - lowest)
    return z, missing


def sense_colour(colour: NDArray[np.uint8], noise: SensorNoise | None, rng: np.random.Generator) -> NDArray[np.uint8]:
    """(H, W, 3) perfect picture -> the same with brightness noise per pixel and colour noise per 2 x 2 block."""
    if noise is None:
        return colour
    if noise.lens_blur_px > 0:
        colour = np.asarray(cv2.GaussianBlur(colour, (0, 0), noise.lens_blur_px), dtype=np.uint8)
    return _compressed(_with_colour_noise(colour, noise, rng), noise)


def _with_colour_noise(colour: NDArray[np.uint8], noise: SensorNoise, rng: np.random.Generator) -> NDArray[np.uint8]:
    if noise.colour_std <= 0:
        return colour
    height, width = colour.shape[:2]
    luma = _normal(rng, (height, width), noise.colour_std)
    red, blue = _normal(rng, (2, (height + 1) // 2, (width + 1) // 2), noise.colour_std / 2)
    blocks = cv2.merge((red, np.float32(-0.5) * (red + blue), blue))
    chroma = cv2.resize(blocks, (width, height), interpolation=cv2.INTER_NEAREST)
    shift = cv2.add(cv2.cvtColor(luma, cv2.COLOR_GRAY2RGB), chroma)
    return np.asarray(cv2.add(colour, shift, dtype=cv2.CV_8U), dtype=np.uint8)


_QUANTILES = ndtri((np.arange(65536) + 0.5) / 65536).astype(np.float32)


def _normal(rng: np.random.Generator, shape: tuple[int, ...], std: float) -> Array32:
    """Normal draws from a table of 65,536 equally likely values, up to 4.3 `std`: four times as fast as exact draws.

    Colours are rounded to grey levels, which is coarser than the table.
    """
    drawn: Array32 = (np.float32(std) * _QUANTILES).take(rng.integers(len(_QUANTILES), size=shape, dtype=np.uint16))
    return drawn


def _compressed(colour: NDArray[np.uint8], noise: SensorNoise) -> NDArray[np.uint8]:
    """The picture after JPEG compression; channels are swapped before and after, because OpenCV expects BGR."""
    if noise.jpeg_quality is None:
        return colour
    data = cv2.imencode(".jpg", colour[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, noise.jpeg_quality))[1]
    return np.ascontiguousarray(np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1], dtype=np.uint8)


INFRARED_FULL = 1000.0
"""Grey level of a white surface at 1 m, facing the camera, which lights the scene itself."""
INFRARED_FLOOR, INFRARED_SHOT = 3.0, 0.6


def sense_infrared(light: Array32, noise: SensorNoise | None, rng: np.random.Generator) -> NDArray[np.uint16]:
    """(H, W) returned light, 1 for a white surface facing the camera at 1 m -> grey levels with read and shot noise."""
    grey = INFRARED_FULL * light
    if noise is not None:
        std = np.sqrt(INFRARED_FLOOR**2 + INFRARED_SHOT**2 * np.maximum(grey, 0))
        grey = grey + std * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.round(grey), 0, 65535).astype(np.uint16)
