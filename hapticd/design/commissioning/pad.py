"""The trackpad's pose, from marks that were touched on the plate."""

from __future__ import annotations

from typing import Final

from .findings import Diagnosis, Flaw, Judgement

ROTATED_DEG: Final = 30.0  # beyond, it lies on another side
AGREE_MM: Final = 3.0


def judge_pad(
    rotation_deg: float, scale_x: float, scale_y: float, left_out_mm: float, *, lies_anyhow: bool = False
) -> Judgement:
    """Judge the placement of the pad that was fitted to marks; `left_out_mm` is the error of a mark left out.

    `lies_anyhow`: the device has no side of its own, such as a touchscreen, and may be rotated or mirrored.
    """
    findings = []
    if left_out_mm > AGREE_MM:
        findings.append(Diagnosis(f"The marks disagree by {left_out_mm:.1f} mm: touch them again, in their order."))
    elif not lies_anyhow and scale_x * scale_y < 0.0:
        findings.append(
            Diagnosis(
                "The trackpad is mirrored: its face is down, or a driver flips an axis. Turn it over.",
                (Flaw.PAD_MIRRORED,),
            )
        )
    elif not lies_anyhow and abs(rotation_deg) > ROTATED_DEG:
        findings.append(
            Diagnosis(
                f"The trackpad is rotated by {rotation_deg:.0f} degrees: turn it round.",
                (Flaw.PAD_ROTATED,),
            )
        )
    figures = (
        ("rotation", f"{rotation_deg:.1f} degrees"),
        ("scales", f"{scale_x:.3f}, {scale_y:.3f}"),
        ("a mark left out", f"{left_out_mm:.2f} mm"),
    )
    return Judgement("The trackpad lies as the plate does.", tuple(findings), figures)
