"""Photos of a chessboard -> the field of view that robot.toml gives the camera (`indoor-mapping calibrate camera`)."""

from __future__ import annotations

from math import atan, degrees

import cv2
import numpy as np

from common.errors import StartError
from onboard.poi.camera.frame import Image


def field_of_view_deg(photos: list[Image], columns: int, rows: int) -> tuple[float, float]:
    """Field of view from side to side, and the remaining error in pixels, from photos of one chessboard.

    `columns` x `rows` inner corners (Zhang 2000, with the axis in the picture's middle and no distortion). Raises
    StartError when no photo shows the board.
    """
    board = np.zeros((rows * columns, 3), np.float32)
    board[:, :2] = np.mgrid[0:columns, 0:rows].T.reshape(-1, 2)
    corners = []
    size_px = (photos[0].shape[1], photos[0].shape[0])
    for photo in photos:
        gray = cv2.cvtColor(photo, cv2.COLOR_BGR2GRAY)
        if (gray.shape[1], gray.shape[0]) != size_px:
            raise StartError("The photos differ in size: take all of them with the robot's camera.")
        found, places = cv2.findChessboardCorners(gray, (columns, rows))
        if found:
            limit = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
            corners.append(cv2.cornerSubPix(gray, places, (5, 5), (-1, -1), limit))
    if not corners:
        raise StartError(f"No photo shows a chessboard of {columns} x {rows} inner corners: hold it nearer.")
    focal_px = float(size_px[0])
    guess = np.array([[focal_px, 0, size_px[0] / 2], [0, focal_px, size_px[1] / 2], [0, 0, 1]])
    flags = (
        cv2.CALIB_USE_INTRINSIC_GUESS
        | cv2.CALIB_FIX_PRINCIPAL_POINT
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K1
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
    )
    error_px, matrix, *_ = cv2.calibrateCamera([board] * len(corners), corners, size_px, guess, None, flags=flags)
    return degrees(2 * atan(size_px[0] / 2 / float(matrix[0, 0]))), float(error_px)
