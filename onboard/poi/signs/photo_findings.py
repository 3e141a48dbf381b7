"""What `read-signs` reports of one sign in a photo: a record of plain values, and the judgement drawn into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2

from onboard.poi.camera.frame import Image
from onboard.poi.camera.sharpness import sharpness
from onboard.poi.signs.sign_reading import SignReading, Verdict
from onboard.poi.signs.site_numbers import SiteNumbers

READ, DOUBTFUL, UNREAD = "read", "doubtful", "unread"
_COLOURS_BGR = {READ: (60, 160, 40), DOUBTFUL: (0, 140, 240), UNREAD: (90, 90, 90)}
_LETTERS_SHARE = 0.013  # height of what is written into a photo, of its longer side
_HERSHEY_PX = 22.0  # height of OpenCV's letters at scale 1


@dataclass(frozen=True, slots=True)
class PhotoFinding:
    """One sign; places in pixels of the photo. `place`: x_m and y_m on the map, where a sidecar gives the pose."""

    image: str
    reading: SignReading
    place: dict[str, float]

    @property
    def waits(self) -> bool:
        """Whether the site's other plates decide if its number counts."""
        return self.reading.verdict is Verdict.DOUBTFUL

    def record(self, site: SiteNumbers) -> dict[str, Any]:
        """The values that are printed, by what is known of the site now."""
        reading = self.reading
        state, reason = self._state(site)
        number = reading.number if state != UNREAD else None
        return {
            "image": self.image,
            "kind": "other" if reading.verdict is Verdict.OTHER else "plate",
            "text": "\n".join(reading.lines),
            "number": number.shown if number is not None else "",
            "key": number.key if number is not None else "",
            "room_type": reading.room_type,
            "confidence": round(reading.confidence, 4),
            "state": state,
            "box": [round(v, 1) for v in reading.box],
            "reason": reason,
        } | self.place

    def _state(self, site: SiteNumbers) -> tuple[str, str]:
        """The state, and why it is not `read`."""
        reading = self.reading
        if reading.number is not None and not site.may_count(reading.number):
            return UNREAD, site.doubt(reading.number)
        if reading.verdict is Verdict.DOUBTFUL and reading.number is not None:
            doubt = site.doubt(reading.number)
            return (DOUBTFUL, doubt) if doubt else (READ, "")
        if reading.verdict is Verdict.UNCLEAR and reading.number is not None:
            return DOUBTFUL, reading.reason
        return (READ if reading.verdict is Verdict.PLATE else UNREAD), reading.reason


def explained(photo: Image, findings: Sequence[PhotoFinding], site: SiteNumbers) -> Image:
    """A copy of the photo with a box around every sign and its judgement above it."""
    drawn = photo.copy()
    letters_px = max(_LETTERS_SHARE * max(photo.shape[:2]), 9.0)
    scale, thick = letters_px / _HERSHEY_PX, max(round(letters_px / 9), 1)
    for finding in findings:
        record = finding.record(site)
        colour = _COLOURS_BGR[record["state"]]
        x, y, width, height = (round(v) for v in finding.reading.box)
        cv2.rectangle(drawn, (x, y), (x + width, y + height), colour, thick)
        for i, line in enumerate(reversed(_explanation(photo, finding, record))):
            at = (max(x, 0), round(y - (0.6 + 1.6 * i) * letters_px))
            text = line.encode("ascii", "replace").decode()
            cv2.putText(drawn, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 3 * thick, cv2.LINE_AA)
            cv2.putText(drawn, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, thick, cv2.LINE_AA)
    return drawn


def _explanation(photo: Image, finding: PhotoFinding, record: dict[str, Any]) -> list[str]:
    number = finding.reading.number
    what = f"{record['number'] or 'no number'} {record['room_type']}".strip()
    why = record["reason"] or (f"form {number.form}" if number is not None else "")
    x, y, width, height = (round(v) for v in finding.reading.box)
    part = photo[max(y, 0) : y + height + 1, max(x, 0) : x + width + 1]
    lines = [f"{what}: {record['kind']}, {record['state']}, {record['confidence']:.2f}", why]
    if part.size:
        sharp = sharpness(cv2.cvtColor(part, cv2.COLOR_BGR2GRAY))
        measures = sharp.gradient, sharp.laplacian_variance, sharp.high_frequency_share
        lines.append("sharp {:.0f} / {:.0f} / {:.3f}".format(*measures))
    return [line for line in lines if line]
