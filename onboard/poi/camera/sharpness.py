"""Sharpness of an image: the measure that ranks photos, and the two measures that the specification names.

Measured on plates with blur: the strong gradients of a picture whose scale and contrast were normalised rank photos by
whether they can be read; variance of the Laplacian and share of high frequencies are reported beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from onboard.poi.camera.frame import Gray

NORMAL_HEIGHT_PX = 160  # every image is scaled to it, so that photos from different distances compare
_HIGH_FREQUENCY = 0.25  # cycles per pixel


@dataclass(frozen=True, slots=True)
class Sharpness:
    """Larger is sharper; comparable between photos only."""

    gradient: float  # ranks photos
    laplacian_variance: float
    high_frequency_share: float


def sharpness(gray: Gray) -> Sharpness:
    """Measures of one picture, which must hold at least 8 x 8 pixels."""
    image = gray.astype(np.float32)
    laplacian = cv2.Laplacian(image, cv2.CV_32F)
    return Sharpness(gradient(gray), float(laplacian.var()), _high_frequency_share(image))


def gradient(gray: Gray) -> float:
    """99th percentile of the gradient along x or y, whichever is smaller: motion blurs one direction only."""
    scale = NORMAL_HEIGHT_PX / gray.shape[0]
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    image = cv2.resize(gray.astype(np.float32), None, fx=scale, fy=scale, interpolation=interpolation)
    image = cv2.GaussianBlur(image, (0, 0), 1.0)
    low, high = np.percentile(image, (2, 98))
    image = ((image - low) / max(float(high - low), 1e-3) * 255.0).astype(np.float32)
    along_x, along_y = (np.percentile(np.abs(cv2.Sobel(image, cv2.CV_32F, *d)), 99) for d in ((1, 0), (0, 1)))
    return float(min(along_x, along_y))


def _high_frequency_share(image: npt.NDArray[np.float32]) -> float:
    power = np.abs(np.fft.rfft2(image - image.mean())) ** 2
    fy, fx = np.fft.fftfreq(image.shape[0])[:, None], np.fft.rfftfreq(image.shape[1])[None, :]
    total = float(power.sum())
    return float(power[np.hypot(fx, fy) > _HIGH_FREQUENCY].sum()) / total if total > 0 else 0.0
