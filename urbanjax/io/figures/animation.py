"""Moving pictures as GIF."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

COLOURS = 64
SAMPLES = 8  # pictures, about, that the palette is chosen from
MARGIN = 6  # px


def write_gif(path: Path, frames: Sequence[np.ndarray], *, rate: float) -> None:
    """Write RGB pictures [H, W, 3] uint8 of equal size as an endless GIF of `rate` pictures per second.

    Args: path of the file; frames, the pictures; rate [1/s].
    """
    from PIL import Image

    if not frames:
        raise ValueError(f"no frames for {path.name}")
    pictures = [Image.fromarray(np.ascontiguousarray(frame)) for frame in frames]
    sample = pictures[:: max(len(pictures) // SAMPLES, 1)]
    strip = Image.new("RGB", (sample[0].width, sum(picture.height for picture in sample)))
    for i, picture in enumerate(sample):
        strip.paste(picture, (0, i * picture.height))
    palette = strip.quantize(COLOURS)  # one palette for all, so that still parts do not flicker
    first, *rest = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    first.save(path, save_all=True, append_images=rest, duration=round(1000 / rate), loop=0, optimize=False)


def stacked(pictures: Sequence[np.ndarray], labels: Sequence[str]) -> np.ndarray:
    """The RGB pictures of equal width one below the other, each with its label in the upper left corner.

    Args: pictures [H, W, 3] uint8; labels, one each.
    """
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default(14)
    rows = []
    for picture, label in zip(pictures, labels, strict=True):
        image = Image.fromarray(np.ascontiguousarray(picture))
        draw = ImageDraw.Draw(image)
        box = draw.textbbox((MARGIN, MARGIN), label, font=font)
        draw.rectangle((box[0] - 4, box[1] - 3, box[2] + 4, box[3] + 3), fill=(255, 255, 255))
        draw.text((MARGIN, MARGIN), label, fill=(40, 40, 40), font=font)
        rows.append(np.asarray(image))
    return np.concatenate(rows, axis=0)
