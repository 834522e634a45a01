"""The learned matchers: the official networks' numbers, their filters by plain loops, checkpoints, extremes."""

import io
import zipfile
from collections.abc import Callable
from typing import Any

import network_golden as golden
import numpy as np
import pytest
import torch
from icymoon.stereo.matchers import check_options, match, network_matchers
from icymoon.stereo.networks import recursive_filters
from icymoon.stereo.networks.dsmnet import DSMNet, concatenate_shifts
from icymoon.stereo.networks.igev import IGEVStereo, VolumeLookUp, correlate_groups
from icymoon.support.errors import IcyMoonError
from torch.nn import functional as F  # noqa: N812, its usual name

BUILD: dict[str, Callable[..., Any]] = {"igev": IGEVStereo, "dsmnet": DSMNet}
CASES = golden.cases()
QUICK = ("igev_b_odd_it4", "igev_c_d64_it6", "dsmnet_b_crop")
#: (largest, median) error, px: arithmetic in another order moves single precision up to a tenth of this.
SINGLE = {"igev": (1e-3, 1e-4), "dsmnet": (0.05, 5e-3)}


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    """More threads are of no use for images this small, and other tests run at the same time."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def states():
    """Parameters of both networks by the rule."""
    found = {}
    for name, build in BUILD.items():
        shapes = {key: tuple(value.shape) for key, value in build().state_dict().items()}
        found[name] = golden.parameters(name, shapes)
    return found


@pytest.fixture(scope="module")
def checkpoints(states, tmp_path_factory):
    """Checkpoints as the training of the authors writes them."""
    folder = tmp_path_factory.mktemp("checkpoints")
    for name, state in states.items():
        stored = {f"module.{key}": torch.from_numpy(value) for key, value in state.items()}
        torch.save({"epoch": 6, "state_dict": stored} if name == "dsmnet" else stored, folder / f"{name}.pth")
    yield folder
    network_matchers._load_network.cache_clear()


def filled(name, states, max_disparity):
    model = BUILD[name](max_disparity)
    model.load_state_dict({key: torch.from_numpy(value) for key, value in states[name].items()}, strict=True)
    return model.double().eval()


@pytest.mark.parametrize("name", BUILD)
def test_names_and_shapes_of_the_parameters_are_the_officials(name, states):
    expected = {case["state_crc"] for case in CASES.values() if case["net"] == name}
    assert {golden.checksum(states[name])} == expected


@pytest.mark.ci_takes(1)
@pytest.mark.parametrize(
    "case",
    [case if case in QUICK else pytest.param(case, marks=[pytest.mark.slow, pytest.mark.long]) for case in CASES],
)
def test_double_precision_is_the_officials_to_a_millionth_of_a_pixel(case, states):
    """Other arithmetic moves double precision by 3e-11 px, the smallest mistake that was tried by 1e-3."""
    case = CASES[case]
    left, right = golden.images(case["image"])
    model = filled(case["net"], states, case["max_disp"])
    with torch.inference_mode():
        if case["net"] == "igev":
            down, across = (-size % 32 for size in left.shape[:2])
            frame = (across // 2, across - across // 2, down // 2, down - down // 2)
            eyes = (
                F.pad(torch.from_numpy(eye).double().permute(2, 0, 1)[None], frame, mode="replicate")
                for eye in (left, right)
            )
            disparity = model(*eyes, case["iters"])[0, 0, frame[2] :, frame[0] :][: left.shape[0], : left.shape[1]]
        else:
            eyes, place = dsmnet_eyes(left, right, *case["crop"])
            disparity = model(*eyes)[0][place]
    assert np.abs(golden.sampled(disparity.numpy(), 512) - case["samples"]).max() < 1e-6
    assert abs(golden.weighted_mean(disparity.numpy()) - case["sum"]) < 1e-6


def dsmnet_eyes(left, right, height, width):
    """Normalised over the whole image in double, rounded to single; middle cropped, or zeros above and to the left."""
    eyes = []
    for image in (left, right):
        whole = ((image - image.mean((0, 1))) / image.std((0, 1))).astype(np.float32)
        missing = height - len(image), width - image.shape[1]
        if max(missing) >= 0:
            framed = np.pad(whole, ((missing[0], 0), (missing[1], 0), (0, 0)))
        else:
            top, near = -missing[0] // 2, -missing[1] // 2
            framed = whole[top : top + height, near : near + width]
        eyes.append(torch.from_numpy(framed).double().permute(2, 0, 1)[None])
    return eyes, (slice(max(missing[0], 0), None), slice(max(missing[1], 0), None))


def assert_single(disparity, case):
    error = np.abs(golden.sampled(disparity, 512) - case["samples"])
    largest, median = SINGLE[case["net"]]
    assert error.max() < largest
    assert np.median(error) < median


@pytest.mark.long
def test_igev_from_a_checkpoint_on_colour_images_of_any_size(checkpoints):
    case = CASES["igev_b_odd_it4"]
    left, right = (eye[..., ::-1] for eye in golden.images(case["image"]))  # images come as BGR
    disparity, valid, info = match(
        "igev", left, right, {"checkpoint": checkpoints / "igev.pth", "iterations": 4, "device": "cpu"}
    )
    assert valid.all()
    assert_single(disparity, case)
    assert info["facts"]["device"] == "cpu"
    assert len(info["facts"]["checkpoint_sha256"]) == 64
    half, _, _ = match(
        "igev", left, right, {"checkpoint": checkpoints / "igev.pth", "iterations": 4, "precision": "bfloat16"}
    )
    # 2^-8 is bfloat16's rounding. With random parameters, which favour no disparity, it moved the median by 0.13 px.
    assert 0 < np.median(np.abs(half - disparity)) < 0.5


def test_dsmnet_from_a_checkpoint_cropped_as_the_paper_did(checkpoints):
    case = CASES["dsmnet_b_crop"]
    left, right = (eye[..., ::-1] for eye in golden.images(case["image"]))
    options = {"checkpoint": checkpoints / "dsmnet.pth", "max_disparity": 96}
    disparity, valid, _ = match("dsmnet", left, right, options | {"crop_height": 128, "crop_width": 192})
    inside = np.zeros_like(valid)
    inside[11 : 11 + 128, 9 : 9 + 192] = True  # the middle of 151 x 211
    np.testing.assert_array_equal(valid, inside)
    assert_single(disparity[inside].reshape(128, 192), case)


@pytest.mark.long
def test_dsmnet_sees_all_of_an_image_by_default(checkpoints):
    case = CASES["dsmnet_c_pad"]
    left, right = (eye[..., ::-1] for eye in golden.images(case["image"]))
    disparity, valid, _ = match("dsmnet", left, right, {"checkpoint": checkpoints / "dsmnet.pth"})
    assert valid.all()
    assert_single(disparity, case)


@pytest.mark.long
@pytest.mark.parametrize("method", BUILD)
@pytest.mark.parametrize("shape", [(1, 1), (3, 70)])
@pytest.mark.parametrize("level", [0, 255])
def test_images_without_anything_in_them(method, shape, level, checkpoints):
    flat = np.full(shape, level, np.uint8)
    options = {"checkpoint": checkpoints / f"{method}.pth", "max_disparity": 64}
    disparity, valid, _ = match(method, flat, flat, options | ({"iterations": 1} if method == "igev" else {}))
    assert disparity.shape == valid.shape == shape
    assert np.isfinite(disparity[valid]).all()


@pytest.mark.parametrize("method", BUILD)
def test_a_missing_checkpoint_is_named_with_its_place(method, tmp_path, monkeypatch):
    monkeypatch.setenv(network_matchers.FOLDER_VARIABLE, str(tmp_path))
    with pytest.raises(
        IcyMoonError,
        match=rf"{method} has no checkpoint at .*{method}.pth; download .*github.com.*"
        rf"put it there, or give {method}.checkpoint=FILE",
    ):
        check_options(method, {})
    with pytest.raises(IcyMoonError, match=r"no checkpoint at .*mine.pth"):
        check_options(method, {"checkpoint": str(tmp_path / "mine.pth")})
    (tmp_path / f"{method}.pth").write_bytes(b"")
    assert check_options(method, {})["checkpoint"] == ""


class Evil:
    """Would run a program when it is unpickled."""

    def __reduce__(self):
        return eval, ("1/0",)


def test_files_that_are_no_checkpoint_are_refused(checkpoints, states, tmp_path):
    good = {key: torch.from_numpy(value) for key, value in states["dsmnet"].items()}
    some = "cost_agg.disp2.conv3d_2d.weight"
    whole = (checkpoints / "dsmnet.pth").read_bytes()

    def saved(stored):
        stream = io.BytesIO()
        torch.save(stored, stream)
        return stream.getvalue()

    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as stream:
        stream.writestr("a.txt", "b")
    for content, reason in [
        (b"", "cannot be read"),
        (b"no parameters", "contains more than parameters"),
        (whole[:5000], "cannot be read"),
        (whole[:-5000], "cannot be read"),
        (archive.getvalue(), "cannot be read"),
        (saved({"a": Evil()}), "contains more than parameters"),
        (saved([1, 2]), "does not contain the parameters"),
        (saved({"epoch": 5}), "does not contain the parameters"),
        (saved({}), r"\d+ of its parameters do not fit"),
        (saved({key: value for key, value in good.items() if key != some}), f"1 of its .* {some} is missing"),
        (saved(good | {"refine.weight": torch.zeros(2)}), "refine.weight is not of this network"),
        (saved(good | {some: torch.zeros(1, 32, 3, 3)}), r"has the shape \(1, 32, 3, 3\), not \(1, 32, 3, 3, 3\)"),
        (saved({"state_dict": {"module.conv.weight": torch.zeros(3)}}), "do not fit"),
    ]:
        path = tmp_path / "wrong.pth"
        path.write_bytes(content)
        with pytest.raises(IcyMoonError, match=reason) as caught:
            match("dsmnet", np.zeros((64, 64), np.uint8), np.zeros((64, 64), np.uint8), {"checkpoint": path})
        assert "\n" not in str(caught.value)


def test_old_checkpoints_without_counts_load(states, tmp_path):
    torch.save(
        {key: torch.from_numpy(value) for key, value in states["dsmnet"].items() if "num_batches" not in key},
        tmp_path / "old.pth",
    )
    network_matchers.fill_parameters(
        DSMNet(64), network_matchers.read_parameters(tmp_path / "old.pth"), tmp_path, "dsmnet"
    )


def test_networks_run_in_full_single_precision_and_failures_are_one_sentence():
    with network_matchers.guard_inference("igev"):
        assert torch.backends.cudnn.enabled
        assert not torch.backends.cudnn.allow_tf32
        assert torch.is_inference_mode_enabled()
    failed = pytest.raises(IcyMoonError, match=r"IGEV-Stereo failed in PyTorch \(.*size")
    with failed as caught, network_matchers.guard_inference("igev"):
        torch.zeros(2) + torch.zeros(3)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_is_not_there_is_named(checkpoints):
    image = np.zeros((64, 64), np.uint8)
    with pytest.raises(IcyMoonError, match=r"igev.device is cuda, but .*use cpu"):
        match("igev", image, image, {"checkpoint": checkpoints / "igev.pth", "device": "cuda"})


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")
@pytest.mark.parametrize(("method", "case"), [("igev", "igev_b_odd_it4"), ("dsmnet", "dsmnet_c_pad")])
def test_cuda_gives_what_the_processor_gives(method, case, checkpoints):
    left, right = (eye[..., ::-1] for eye in golden.images(CASES[case]["image"]))
    options = {"checkpoint": checkpoints / f"{method}.pth", "device": "cuda"}
    disparity, _, _ = match(method, left, right, options | ({"iterations": 4} if method == "igev" else {}))
    assert_single(disparity, CASES[case])


@pytest.mark.parametrize("build", BUILD.values())
def test_a_reach_that_the_volume_cannot_have_is_refused(build):
    for wrong in (0, 100):
        with pytest.raises(ValueError, match="not a multiple"):
            build(wrong)


def test_no_iteration_is_refused():
    image = torch.zeros(1, 3, 32, 32)
    with pytest.raises(ValueError, match="iterations"):
        IGEVStereo(64)(image, image, 0)


#: Scan -> (order of rows, order of columns, columns first, the filtered neighbours).
SCANS = (
    ((1, 1, False), ((-1, 0), (-1, -1), (-1, 1), (0, -1))),
    ((-1, -1, False), ((1, 0), (1, -1), (1, 1), (0, 1))),
    ((1, 1, True), ((0, -1), (-1, -1), (1, -1), (-1, 0))),
    ((-1, -1, True), ((0, 1), (-1, 1), (1, 1), (1, 0))),
)


def plain_nlf(x, guide):
    height, width = x.shape[1:]
    for (down, along, columns_first), neighbours in SCANS:
        places = [(r, c) for r in range(height)[::down] for c in range(width)[::along]]
        if columns_first:
            places.sort(key=lambda place: (along * place[1], down * place[0]))
        out = np.full_like(x, np.nan)
        for r, c in places:
            near = [(r + dr, c + dc) for dr, dc in neighbours]
            inside = [0 <= a < height and 0 <= b < width for a, b in near]
            logits, values = [guide[:, r, c] @ guide[:, r, c]], [x[:, r, c]]
            for place, there in zip(near, inside, strict=True):
                logits.append(guide[:, r, c] @ guide[:, *place] if there else 0.0)
                values.append(out[:, *place] if there else x[:, r, c])
            out[:, r, c] = np.exp(logits) @ np.array(values) / np.exp(logits).sum()
        x = out
    return x


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (6, 1), (4, 7), (7, 4)])
def test_nlf_is_the_plain_recursion(shape):
    random = np.random.default_rng(1)
    x, guide = random.standard_normal((2, 2, 3, *shape))
    got = recursive_filters.filter_non_local(torch.from_numpy(x), torch.from_numpy(guide)).numpy()
    for part, own, weights in zip(got, x, guide, strict=True):
        np.testing.assert_allclose(part, plain_nlf(own, weights), atol=1e-13)


def plain_sga(x, weights):
    planes, height, width = x.shape[1:]
    results = []
    for scan, (down, along) in enumerate(((1, 0), (-1, 0), (0, 1), (0, -1))):
        w = weights[5 * scan : 5 * scan + 5]
        w = w / np.abs(w).sum(0)
        out = np.full_like(x, np.nan)
        for r in range(height)[:: down or 1]:
            for c in range(width)[:: along or 1]:
                before = r - down, c - along
                if not (0 <= before[0] < height and 0 <= before[1] < width):
                    out[:, :, r, c] = x[:, :, r, c] * w[:, r, c].sum()
                    continue
                last = out[:, :, before[0], before[1]]
                for d in range(planes):
                    own = x[:, d, r, c]
                    less = last[:, d - 1] if d else own
                    more = last[:, d + 1] if d + 1 < planes else own
                    out[:, d, r, c] = (
                        w[0, r, c] * own
                        + w[1, r, c] * last[:, d]
                        + w[2, r, c] * less
                        + w[3, r, c] * more
                        + w[4, r, c] * last.max(1)
                    )
        results.append(out)
    return np.max(results, axis=0)


@pytest.mark.parametrize("trained", [False, True])
@pytest.mark.parametrize("shape", [(1, 1, 1), (2, 3, 1), (4, 3, 5)])
def test_sga_is_the_plain_recursion(shape, trained):
    random = np.random.default_rng(2)
    x, weights = random.standard_normal((2, 3, *shape)), random.standard_normal((2, 20, *shape[1:]))
    given = torch.from_numpy(x).requires_grad_(trained)
    got = recursive_filters.aggregate_semi_global(given, torch.from_numpy(weights)).detach().numpy()
    for part, own, w in zip(got, x, weights, strict=True):
        np.testing.assert_allclose(part, plain_sga(own, w), atol=1e-13)


@pytest.mark.parametrize("name", ["filter_non_local", "aggregate_semi_global"])
def test_recursions_have_the_gradients_of_finite_differences(name):
    torch.manual_seed(0)
    shapes = {
        "filter_non_local": ((1, 2, 3, 3), (1, 4, 3, 3)),
        "aggregate_semi_global": ((1, 1, 3, 2, 3), (1, 20, 2, 3)),
    }
    given = [torch.randn(shape, dtype=torch.float64, requires_grad=True) for shape in shapes[name]]
    assert torch.autograd.gradcheck(getattr(recursive_filters, name), given)


def test_volumes_compare_a_pixel_with_the_one_it_would_match():
    left, right = torch.randn(2, 1, 16, 3, 9, dtype=torch.float64)
    correlation, both = correlate_groups(left, right, 12), concatenate_shifts(left, right, 12)
    for shift in (0, 4, 8, 11):
        for column in range(9):
            seen = (
                torch.cat((left[0, :, 1, column], right[0, :, 1, column - shift]))
                if column >= shift
                else torch.zeros(32, dtype=torch.float64)
            )
            torch.testing.assert_close(both[0, :, shift, 1, column], seen)
            torch.testing.assert_close(correlation[0, :, shift, 1, column], (seen[:16] * seen[16:]).view(8, 2).mean(1))


def test_the_look_up_is_grid_sampling_with_zeros_outside():
    """Against torch's own sampler, whose normalised coordinates round in the last place."""
    volume = torch.randn(1, 8, 6, 2, 10, dtype=torch.float64)
    left, right = torch.randn(2, 1, 12, 2, 10, dtype=torch.float64)[:, 0][:, None].unbind(0)
    disparity = torch.rand(1, 1, 2, 10, dtype=torch.float64) * 16 - 4
    got = VolumeLookUp(volume, left, right)(disparity)
    rows = torch.einsum("chi,chj->hij", left[0], right[0])
    expected = []
    for level in range(2):
        for line, centre in (
            (volume[0].permute(2, 3, 0, 1), disparity[0, 0]),
            (rows[:, :, None], torch.arange(10) - disparity[0, 0]),
        ):
            line = F.avg_pool1d(line.flatten(0, 1), 2**level) if level else line.flatten(0, 1)
            places = centre.flatten()[:, None] / 2**level + torch.arange(-4, 5)
            grid = torch.stack((2 * places / (line.shape[2] - 1) - 1, torch.zeros_like(places)), -1)[:, None]
            expected.append(F.grid_sample(line[:, :, None], grid, align_corners=True).flatten(1))
    torch.testing.assert_close(got[0].flatten(1).T, torch.cat(expected, 1), atol=1e-12, rtol=1e-12)
