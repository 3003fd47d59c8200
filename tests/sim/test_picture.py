"""Pictures show what they say, and are drawn without blocking anybody."""

import asyncio
import io
import time
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from sim import robots
from sim.order import MotionOrder
from sim.rendering import picture
from sim.rendering.picture import PictureFailed
from sim.rendering.worker import plate_of


def pixels_near(image, colour, tolerance=40):
    return int((np.abs(np.asarray(image.convert("RGB"), dtype=int) - colour).max(axis=2) < tolerance).sum())


@pytest.mark.slow
async def test_the_operator_card_shows_arm_nozzle_and_path(planned):
    plan = planned(MotionOrder(time_step=0.008, timing="constant_speed", speed=0.03))
    drawing = asyncio.create_task(picture.operator_card(robots.load(), plan))
    longest, last = 0.0, time.monotonic()
    while not drawing.done():
        await asyncio.sleep(0.005)
        longest, last = max(longest, time.monotonic() - last), time.monotonic()
    image = Image.open(io.BytesIO(await drawing))
    assert (image.format, image.height) == ("PNG", 760)
    assert image.width > 2000
    assert longest < 1.5  # drawing takes many times longer: held up, it would show
    work = image.crop((768, 0, 1528, 760))
    assert pixels_near(work, (235, 110, 20)) > 500
    assert pixels_near(work, (40, 90, 200)) > 500


def test_the_card_shows_the_part_that_the_recipe_names_and_else_what_is_kept_clear(planned):
    plan = planned(MotionOrder(time_step=0.008, timing="constant_speed", speed=0.03))
    path = np.array([[0.0, 10.0, 0.0], [30.0, 90.0, 0.0]])
    low, high, look = plate_of(plan, path)
    assert (low.tolist(), high.tolist(), look["linestyle"]) == ([-20.0, -10.0], [50.0, 110.0], ":")
    named = replace(plan, order=replace(plan.order, part_x=-0.02, part_y=-0.01, part_length=0.12, part_width=0.2))
    low, high, look = plate_of(named, path)
    assert low == pytest.approx([-20.0, -10.0])
    assert high == pytest.approx([100.0, 190.0])
    assert look["linestyle"] == "-"


@pytest.mark.slow
async def test_the_animation_moves(planned):
    plan = planned(MotionOrder(time_step=0.008, timing="constant_speed", speed=0.03), "xarm6")
    image = Image.open(io.BytesIO(await picture.animation(robots.load("xarm6"), plan, 5)))
    assert image.format == "WEBP"
    assert image.n_frames == 5
    image.seek(0)
    first = np.asarray(image.convert("RGB"), dtype=int)
    image.seek(image.n_frames // 2)
    assert (np.abs(np.asarray(image.convert("RGB"), dtype=int) - first).max(axis=2) > 40).mean() > 0.02


async def test_a_picture_that_cannot_be_drawn_says_so_in_a_sentence(planned):
    with pytest.raises(PictureFailed, match="could not be drawn: AttributeError"):
        await picture.still(robots.load(), None)
