"""Commands that sentences about height maps name: each is run here, and what it makes is read without a complaint."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from icymoon.formats import gdal_lines, geotiff, sidecar_files
from icymoon.formats.geotiff import Site
from icymoon.nodes.ground.import_heights import read_heights
from icymoon.nodes.ground.user_ground import find_kind
from icymoon.support.arrays import Array
from icymoon.support.errors import IcyMoonError
from tiffs import write_tiff

rasterio = pytest.importorskip("rasterio", reason="pip install rasterio, which only tests need")
pytestmark = pytest.mark.filterwarnings(
    "ignore::rasterio.errors.NotGeoreferencedWarning", "ignore::PendingDeprecationWarning"
)
WITH_GDAL = pytest.mark.skipif(shutil.which("gdal_translate") is None, reason="apt install gdal-bin")
DATA = Path(__file__).parents[1] / "data" / "heights"
VALUES = np.array([[1.5, 20.0, 2.0, 7.0], [3.0, 4.0, 5.0, 8.0], [6.0, 1.0, 9.0, 2.5]], np.float32)
METADATA = '<GDALMetadata><Item name="SCALE" sample="0" role="scale">{}</Item>{}</GDALMetadata>'
BOMB = '<!DOCTYPE a [<!ENTITY b "bbbbbbbbbb"><!ENTITY c "&b;&b;&b;">]><GDALMetadata>&c;</GDALMetadata>'
EUROPA = "+proj=stere +lat_0=90 +R=1560800 +units=m"
EUROPA_M = 1560800.0


def run(command: str, folder: Path) -> None:
    ended = subprocess.run(["bash", "-c", command], cwd=folder, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 0, (command, ended.stderr)


def follow(sentence: str, folder: Path) -> Path:
    """Run the command that ends a sentence in the folder of its file; the file that it made or changed."""
    command = re.search(r"in its folder with: (gdal.*)$", sentence)[1]
    if command.startswith("gdal_edit.py") and shutil.which("gdal_edit.py") is None:
        pytest.skip("apt install python3-gdal")
    run(command, folder)
    return folder / re.search(r'(?:"([^"]+)"|(\S+))$', command)[0].strip('"')


def by_rasterio(path: Path, values: Array = VALUES, **options) -> Path:
    options = {"crs": EUROPA, "transform": rasterio.transform.from_origin(1000, -500, 2, 3), "count": 1, **options}
    rows, columns = values.shape
    with rasterio.open(path, "w", driver="GTiff", height=rows, width=columns, dtype=values.dtype, **options) as out:
        for band in range(options["count"]):
            out.write(values + values.dtype.type(band), band + 1)
    return path


def two_units(path: Path) -> Path:
    unit = '<Item name="U" sample="0" role="unittype">m</Item>'
    return write_tiff(path, VALUES, pixel=(2.0, 3.0), keys={3076: 9001, 4099: 9002}, metadata=METADATA.format(1, unit))


def data_file(name: str):
    return lambda path: Path(shutil.copyfile(DATA / f"{name}.tif", path))


def small(**options):
    return lambda path: write_tiff(path, VALUES, **{"pixel": (2.0, 3.0), **options})


#: Files that are refused, and the first height of what the command makes of each, in metres; None for that of the hill.
REFUSED = {
    "lerc": (data_file("lerc"), None),
    "unit": (data_file("unit_unknown"), None),
    "depths": (data_file("depths"), "negative"),
    "scale 0": (small(metadata=METADATA.format("0", "")), 1.5),
    "scale no number": (small(metadata=METADATA.format("one", "")), 1.5),
    "entities": (small(metadata=BOMB), 1.5),
    "long metadata": (small(metadata=f'<GDALMetadata><Item name="X">{"a" * 2**20}</Item></GDALMetadata>'), 1.5),
    "two units": (two_units, 1.5 * 0.3048),
    "third number": (small(scale_z=2.0, tie=(0, 0, 1, 0, 0, 10)), 11.0),
    "negative size": (small(pixel=(2.0, -3.0)), 1.5),
    "bands": (lambda path: by_rasterio(path, count=3), 1.5),
    "12 bits": (lambda path: by_rasterio(path, (100 * VALUES).astype(np.uint16), NBITS=12), 150.0),
    "JPEG": (lambda path: by_rasterio(path, np.full((16, 16), 7, np.uint8), compress="JPEG"), 7.0),
}


@WITH_GDAL
@pytest.mark.parametrize("name", REFUSED)
def test_the_command_makes_a_file_that_is_read(tmp_path, name):
    make, first = REFUSED[name]
    path = make(tmp_path / "my dem.tif")  # a name that a shell would split
    with pytest.raises(IcyMoonError) as caught:
        geotiff.read(path)
    read = geotiff.read(follow(str(caught.value), tmp_path))
    hill = 40.0 + 0.5 + 0.25 * -1.5 + 0.01 * -1.5
    wanted = hill if first is None else -hill if first == "negative" else first
    assert read.heights_m[0, 0] == pytest.approx(wanted, rel=1e-5)
    assert read.pixel_m == pytest.approx((2.0, 3.0))
    assert read.warnings == ()


@WITH_GDAL
def test_units_by_number_are_stated_by_the_command(tmp_path):
    path = data_file("feet_by_number")(tmp_path / "a.tif")
    read = geotiff.read(follow(geotiff.read(path).unplaced, tmp_path))
    assert read.pixel_m == pytest.approx((2.0, 3.0))


@WITH_GDAL
def test_degrees_on_an_unknown_body_get_the_radius_of_the_sites(tmp_path):
    site = Site(True, (0.0, 0.0), 2.0, EUROPA_M)
    path = write_tiff(tmp_path / "a{b}.tif", VALUES, pixel=(1e-4, 1e-4), geographic=True, keys={})
    read = geotiff.read(follow(geotiff.read(path, site).unplaced, tmp_path), site)
    assert read.pixel_m == pytest.approx((math.radians(1e-4) * EUROPA_M,) * 2, rel=1e-6)
    assert read.warnings == ()


@WITH_GDAL
def test_a_turned_grid_is_a_map_without_false_heights(tmp_path):
    """The corners that a turned grid leaves have no height, not one of 0 m."""
    turned = rasterio.transform.from_origin(1000, -500, 2, 3) * rasterio.Affine.rotation(20)
    path = by_rasterio(tmp_path / "a.tif", np.full((40, 50), 1234.5), transform=turned)
    with pytest.raises(IcyMoonError, match="turned against north") as caught:
        geotiff.read(path)
    heights = geotiff.read(follow(str(caught.value), tmp_path)).heights_m
    assert np.isnan(heights).any()
    assert np.nanmax(np.abs(heights - 1234.5)) < 1e-9


@WITH_GDAL
@pytest.mark.parametrize(
    ("side", "options", "command"),
    [
        (10_000, {"blockysize": 10_000}, "store it in tiles"),
        (8192, {"tiled": True, "blockxsize": 256, "blockysize": 256}, "make it coarser"),
    ],
)
def test_a_file_that_takes_too_much_memory_is_stored_or_made_so_that_it_does_not(tmp_path, side, options, command):
    path = by_rasterio(tmp_path / "a.tif", np.full((side, side), 7, np.uint8), compress="deflate", **options)
    site = Site(True, (0.0, 0.0), 50.0) if command == "store it in tiles" else None
    with pytest.raises(IcyMoonError, match=command) as caught:
        geotiff.read(path, site)
    assert (geotiff.read(follow(str(caught.value), tmp_path), site).heights_m == 7).all()


def plane(path: Path, crs: str, middle: tuple[float, float], size: int = 80) -> Path:
    """A plane that rises by 0.5 m per metre of ground to the east, on a map of Europa."""
    warp = pytest.importorskip("rasterio.warp")
    transform = rasterio.transform.from_origin(middle[0] - size, middle[1] + size, 2.0, 2.0)
    rows, columns = np.mgrid[:size, :size]
    xs, ys = rasterio.transform.xy(transform, rows.ravel(), columns.ravel())
    lon, _ = map(np.array, warp.transform(crs, f"+proj=longlat +R={EUROPA_M}", xs, ys))
    (lon0,), (lat0,) = warp.transform(crs, f"+proj=longlat +R={EUROPA_M}", [middle[0]], [middle[1]])
    east = np.radians(lon - lon0) * np.cos(np.radians(lat0)) * EUROPA_M
    return by_rasterio(path, (100.0 + 0.5 * east).reshape(size, size), crs=crs, transform=transform)


@WITH_GDAL
@pytest.mark.parametrize("crs", [f"+proj=sinu +R={EUROPA_M}", f"+proj=poly +R={EUROPA_M}"])
def test_a_map_without_a_true_scale_is_projected_by_the_command(tmp_path, crs):
    path = plane(tmp_path / "s.tif", crs, (9e5, 1.3e6))
    with pytest.raises(IcyMoonError) as caught:
        geotiff.read(path, Site(True, (0.0, 0.0), 60.0))
    read = geotiff.read(follow(str(caught.value), tmp_path), Site(True, (0.0, 0.0), 60.0))
    assert read.warnings == ()
    rows, columns = read.heights_m.shape
    rise = np.diff(read.heights_m[rows // 2, columns // 2 - 5 : columns // 2 + 5]).mean() / read.pixel_m[0]
    assert rise == pytest.approx(0.5, rel=2e-3)


#: Files that GDAL makes of a map: driver, suffix, options, the type of numbers.
DRIVERS = {
    "asc": ("AAIGrid", "dem.asc", ""),
    "hgt": ("SRTMHGT", "N46E007.hgt", ""),
    "cub": ("ISIS3", "dem.cub", ""),
    "jp2": ("JP2OpenJPEG", "dem.jp2", "-co REVERSIBLE=YES -co QUALITY=100"),
    "dt0": ("DTED", "n46.dt0", ""),
    "grd": ("GSBG", "dem.grd", ""),
    "nc": ("netCDF", "dem.nc", ""),
    "vrt": ("VRT", "dem.vrt", ""),
    "bil": ("EHdr", "dem.bil", ""),
    "img": ("HFA", "dem.img", ""),
    "flt": ("EHdr", "dem.flt", "-ot Float32"),
}


def heights_in(folder: Path, kind: str) -> Path:
    """A map of a kind that its driver writes: a tile of a degree for two of them."""
    rows, columns = {"hgt": (1201, 1201), "dt0": (121, 121)}.get(kind, (20, 30))
    values = (np.add.outer(np.arange(rows), np.arange(columns)) % 500).astype(np.int16)
    step = 1 / (columns - 1)
    tile = rasterio.transform.from_origin(7 - step / 2, 47 + step / 2, step, step)
    place = (
        {"crs": "EPSG:4326", "transform": tile}
        if kind in ("hgt", "dt0")
        else {"transform": rasterio.transform.from_origin(1000, -500, 2, 2)}
    )
    return by_rasterio(folder / "source.tif", values, **place)


@WITH_GDAL
@pytest.mark.parametrize("kind", DRIVERS)
def test_files_of_other_formats_are_answered_with_a_command_that_works(tmp_path, kind):
    driver, name, options = DRIVERS[kind]
    source = heights_in(tmp_path, kind)
    if driver not in subprocess.run(["gdalinfo", "--formats"], capture_output=True, text=True, check=True).stdout:
        pytest.skip(f"this GDAL has no {driver}")
    run(f"gdal_translate -of {driver} {options} source.tif {name}", tmp_path)
    path = tmp_path / name
    assert find_kind(path) == "HEIGHT_MAP"
    with pytest.raises(IcyMoonError, match=rf"{re.escape(name)}: is .*gdal_translate") as caught:
        read_heights(path)
    made = follow(str(caught.value), tmp_path)
    read, wanted = read_heights(made), geotiff.read(source)
    np.testing.assert_array_equal(read.values, wanted.heights_m)
    assert read.pixel_m == pytest.approx(wanted.pixel_m, rel=1e-6)
    without = kind in ("asc", "grd", "bil", "flt", "jp2", "nc")
    assert all("no unit of length" in warning for warning in read.warnings) if without else read.warnings == ()


@WITH_GDAL
def test_degrees_are_stated_by_the_option_of_the_sentence(tmp_path):
    by_rasterio(
        tmp_path / "source.tif",
        crs=f"+proj=longlat +R={EUROPA_M}",
        transform=rasterio.transform.from_origin(15, 50, 1e-4, 1e-4),
    )
    run("gdal_translate -of AAIGrid source.tif dem.asc", tmp_path)
    (tmp_path / "dem.prj").unlink()
    with pytest.raises(IcyMoonError) as caught:
        read_heights(tmp_path / "dem.asc", body_radius_m=EUROPA_M)
    option, line = re.search(r"degrees, add (.*); convert it in its folder with: (.*)", str(caught.value)).groups()
    run(line.replace("gdal_translate", f"gdal_translate {option}"), tmp_path)
    read = geotiff.read(tmp_path / "dem.tif", Site(True, (0.0, 0.0), 40.0))
    north = math.radians(1e-4) * EUROPA_M
    assert read.pixel_m == pytest.approx((north * math.cos(math.radians(49.99985)), north), rel=1e-4)
    assert read.warnings == ()


def pds3(folder: Path, detached: bool) -> Path:
    """A PDS3 image of LOLA's kind, with its scale and offset, whose label is beside or within it."""
    values = np.arange(20, dtype="<i2").reshape(4, 5)
    head = 0 if detached else 2
    label = "\r\n".join(
        [
            "PDS_VERSION_ID = PDS3",
            "RECORD_TYPE = FIXED_LENGTH",
            "RECORD_BYTES = 1024",
            f"FILE_RECORDS = {head + 1}",
            *(['^IMAGE = "DEM.IMG"'] if detached else ["LABEL_RECORDS = 2", "^IMAGE = 3"]),
            "OBJECT = IMAGE",
            "LINES = 4",
            "LINE_SAMPLES = 5",
            "SAMPLE_TYPE = LSB_INTEGER",
            "SAMPLE_BITS = 16",
            "SCALING_FACTOR = 0.5",
            "OFFSET = 1737400.0",
            "BANDS = 1",
            "END_OBJECT = IMAGE",
            "OBJECT = IMAGE_MAP_PROJECTION",
            'MAP_PROJECTION_TYPE = "SIMPLE CYLINDRICAL"',
            "A_AXIS_RADIUS = 1737.4 <KM>",
            "B_AXIS_RADIUS = 1737.4 <KM>",
            "C_AXIS_RADIUS = 1737.4 <KM>",
            "CENTER_LATITUDE = 0.0 <DEG>",
            "CENTER_LONGITUDE = 0.0 <DEG>",
            "MAP_SCALE = 10.0 <M/PIXEL>",
            "MAP_RESOLUTION = 3032.33 <PIX/DEG>",
            "LINE_PROJECTION_OFFSET = 2.0 <PIXEL>",
            "SAMPLE_PROJECTION_OFFSET = 2.5 <PIXEL>",
            "END_OBJECT = IMAGE_MAP_PROJECTION",
            "END",
            "",
        ]
    ).encode()
    if detached:
        (folder / "dem.lbl").write_bytes(label)
    (folder / "DEM.IMG").write_bytes((b"" if detached else label.ljust(2048)) + values.tobytes().ljust(1024, b"\0"))
    return folder / "DEM.IMG"


@WITH_GDAL
@pytest.mark.parametrize(("detached", "given"), [(True, "dem.lbl"), (True, "DEM.IMG"), (False, "DEM.IMG")])
def test_pds_images_are_answered_with_the_file_that_gdal_opens(tmp_path, detached, given):
    pds3(tmp_path, detached)
    if given == "DEM.IMG" and detached:
        (tmp_path / "dem.lbl").rename(tmp_path / "DEM.lbl")
    with pytest.raises(IcyMoonError, match="gdal_translate") as caught:
        read_heights(tmp_path / given)
    read = read_heights(follow(str(caught.value), tmp_path), Site(True, (0.0, 0.0), 40.0))
    np.testing.assert_array_equal(read.values, 1737400.0 + 0.5 * np.arange(20).reshape(4, 5))
    assert read.pixel_m == pytest.approx((10.0, 10.0))
    assert read.warnings == ()


def test_an_image_without_its_label_and_a_tile_without_its_corner_are_named(tmp_path):
    (tmp_path / "dem.img").write_bytes(bytes(64))
    with pytest.raises(IcyMoonError, match=r"dem\.lbl is not beside it"):
        read_heights(tmp_path / "dem.img")
    (tmp_path / "mine.hgt").write_bytes(bytes(64))
    with pytest.raises(IcyMoonError, match=r"south-west corner, such as N46E007\.hgt"):
        read_heights(tmp_path / "mine.hgt")


@pytest.mark.parametrize("keep", [4, 20, 200, 0.5, 0.9])
def test_a_torn_file_is_not_sent_to_a_program_that_cannot_mend_it(tmp_path, keep):
    data = (DATA / "lzw_long.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(data[: keep if keep > 1 else int(keep * len(data))])
    with pytest.raises(IcyMoonError, match="copy it again from where it is whole") as caught:
        geotiff.read(tmp_path / "a.tif")
    assert "gdal" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("dem.tif", "dem.tif"),
        ("my dem.tif", '"my dem.tif"'),
        ("-o.tif", '"./-o.tif"'),
        ('a"$b`.tif', '"a\\"\\$b\\`.tif"'),
    ],
)
def test_names_are_one_word_of_a_shell(name, word):
    assert gdal_lines.quote_name(name) == word
    said = subprocess.run(["bash", "-c", f"printf %s {word}"], capture_output=True, text=True, check=True).stdout
    assert said.removeprefix("./") == name


@WITH_GDAL
@pytest.mark.parametrize("suffix", [".tfw", ".TFW", ".tifw", ".wld"])
def test_a_world_file_beside_a_map_without_a_place_is_named_and_written_into_it(tmp_path, suffix):
    path = write_tiff(tmp_path / "a.tif", VALUES)
    plain = geotiff.read(path)
    assert (plain.unplaced, plain.warnings) == (sidecar_files.NO_PIXEL_SIZE, ())
    path.with_suffix(suffix).write_text("2\n0\n0\n-3\n1001\n-501.5\n", encoding="utf-8")
    read = geotiff.read(path)
    assert f"a{suffix} beside it is not read" in read.unplaced
    assert [warning for warning in read.warnings if f"a{suffix} beside it" in warning]
    if suffix == ".TFW":  # which GDAL finds where the disk has a folder's names
        return
    made = geotiff.read(follow(read.unplaced, tmp_path))
    rows = len(VALUES)
    assert made.pixel_m == (2.0, 3.0)
    assert made.corner_m == (1001.0, -501.5 - 3 * (rows - 1))
    assert not [warning for warning in made.warnings if "beside it" in warning]


def test_a_world_file_beside_a_map_with_a_place_changes_nothing(tmp_path):
    path = write_tiff(tmp_path / "a.tif", VALUES, pixel=(2.0, 3.0))
    plain = geotiff.read(path)
    path.with_suffix(".tfw").write_text("9\n0\n0\n-9\n0\n0\n", encoding="utf-8")
    assert geotiff.read(path).warnings == plain.warnings


@WITH_GDAL
@pytest.mark.parametrize(
    ("element", "words"),
    [
        ("<GeoTransform> 1000, 2, 0, -500, 0, -3</GeoTransform>", "its place"),
        ('<SRS dataAxisToSRSAxisMapping="1,2">GEOGCS[]</SRS>', "its map system"),
        ('<PAMRasterBand band="1"><NoDataValue>3</NoDataValue></PAMRasterBand>', "which heights are missing"),
        (
            '<PAMRasterBand band="1"><Offset>5</Offset><Scale>2</Scale></PAMRasterBand>',
            "the scale of its heights, their",
        ),
        ('<PAMRasterBand band="1"><Metadata><MDI key="STATISTICS_MEAN">3</MDI></Metadata></PAMRasterBand>', ""),
    ],
)
def test_what_notes_of_gdal_state_is_named_and_written_into_the_map(tmp_path, element, words):
    path = write_tiff(tmp_path / "a.tif", VALUES, pixel=(2.0, 3.0))
    plain = geotiff.read(path).warnings
    (tmp_path / "a.tif.aux.xml").write_text(f"<PAMDataset>{element}</PAMDataset>", encoding="utf-8")
    told = [each for each in geotiff.read(path).warnings if each not in plain]
    assert len(told) == bool(words)
    if words == "which heights are missing":
        assert np.isnan(geotiff.read(follow(told[0], tmp_path)).heights_m).sum() == (VALUES == 3).sum() > 0
    elif words:
        assert words in told[0]


def test_notes_that_cannot_be_read_are_named(tmp_path):
    path = write_tiff(tmp_path / "a.tif", VALUES, pixel=(2.0, 3.0))
    (tmp_path / "a.tif.aux.xml").write_bytes(b"\xff\xfe\x00\xd8")
    assert "a.tif.aux.xml beside it cannot be read" in " ".join(geotiff.read(path).warnings)


@WITH_GDAL
def test_a_world_file_beside_heights_of_png_is_named_and_used(tmp_path):
    heights = np.array([[100, 200, 300], [400, 500, 600]], np.uint16)
    with rasterio.open(tmp_path / "a.png", "w", driver="PNG", height=2, width=3, count=1, dtype="uint16") as out:
        out.write(heights, 1)
    for left in tmp_path.glob("*.xml"):
        left.unlink()
    assert read_heights(tmp_path / "a.png").unplaced == sidecar_files.NO_PIXEL_SIZE
    (tmp_path / "a.pgw").write_text("2\n0\n0\n-3\n1001\n-501.5\n", encoding="utf-8")
    read = read_heights(tmp_path / "a.png")
    assert "a.pgw beside it" in read.warnings[0]
    made = geotiff.read(follow(read.unplaced, tmp_path))
    assert (made.pixel_m, made.heights_m.tolist()) == ((2.0, 3.0), heights.tolist())
