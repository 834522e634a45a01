"""The stereo camera and its sensor."""

from __future__ import annotations

from typing import Literal

from .declaration import ADVANCED, Section, Table, choice, degrees, fraction, metres, number, text, tick
from .relevance import Condition, chosen, nonzero, positive, ticked

MOSAIC = ~chosen("colour", "MONO")
BRACKETED = Condition(lambda asked: asked.value("brackets") > 1)
MOVES = nonzero(
    "speed_right_m_s", "speed_down_m_s", "speed_forward_m_s", "turn_right_deg_s", "turn_down_deg_s", "roll_deg_s")
ALIKE, CALIBRATED = chosen("rig.eyes", "ALIKE"), chosen("rig.eyes", "CALIBRATED")
LENS = Section("lens", "Lens", "Principal point, distortion and focus of the lens")
ALIGNMENT = Section("alignment", "Alignment", "Alignment of the two eyes")
TURN = Section("turn", "Direction", "Rotation vector from the axes of the parallel pair to those of the eye")
MODEL = Section("model", "Lens Model", "Numbers of the lens, as calibrated")
PRISM = Section("prism", "Thin Prism", "Coefficients of a thin prism, as calibrated")
MOTION = Section("motion", "Motion", "Motion of the cameras during the exposure")
HEAD = Section("head", "More Cameras", "Cameras beside the pair that see the same scene, from a file")
OPTICS = Section("optics", "Optics", "Aperture, wavelengths and sharpness of lens and filter")
DEPOSITS = Section("deposits", "Deposits", "Dust or frost on the windows before the lenses")
MOSAICKING = Section("mosaic", "Colour", "The Bayer mosaic, demosaicing and white balance", shown=MOSAIC)
FILTERS = Section("filters", "Colour Filters", "Wavelengths that the red, green and blue filters pass", shown=MOSAIC)
DETECTOR = Section("detector", "Detector", "From photons to numbers")
NOISE = Section("noise", "Noise", "Noise of the sensor, between exposures and between pixels")
RADIATION = Section("radiation", "Radiation", "Tracks of charged particles, as in Jupiter's belts")


class RigSettings(Table, label="Stereo Camera", brief="Camera"):
    """Two identical cameras, parallel unless toed in. The left eye is the reference."""

    __slots__ = ()
    baseline_m: float = metres(
        "Baseline", 0.25, 1.0e-4, 100.0, (0.02, 1.0), "Distance between the two optical centres", "camera")
    focal_length_mm: float = number(
        "Focal Length", 32.0, 1.0, 5000.0, (5.0, 200.0), "Focal length of both lenses", "camera", "mm",
        subtype="DISTANCE_CAMERA")
    sensor_width_mm: float = number(
        "Sensor Width", 60.0, 1.0, 100.0, (5.0, 70.0), "Width of both sensors; pixels are square", "camera", "mm",
        subtype="DISTANCE_CAMERA", section=ADVANCED)
    width_px: int = number(
        "Image Width", 640, 4, 16384, (64, 2048), "Columns of the images", "camera", "px", subtype="PIXEL")
    height_px: int = number(
        "Image Height", 480, 4, 16384, (64, 2048), "Rows of the images", "camera", "px", subtype="PIXEL")
    height_m: float = metres(
        "Height above Ground", 1.6, 1.0e-3, 1.0e4, (0.3, 5.0), "Height of the left camera above the ground beneath it",
        "camera")
    pitch_deg: float = degrees(
        "Pitch Down", 45.84, -90.0, 90.0, "Angle of the optical axis below the horizontal", "camera")
    heading_deg: float = degrees(
        "Heading", 0.0, -360.0, 360.0, "Direction of the optical axis from north (+Y) over east (+X)", "camera",
        section=ADVANCED)
    roll_deg: float = degrees(
        "Roll", 0.0, -180.0, 180.0, "Clockwise rotation of the whole rig about the left camera's optical axis; 0 is "
        "level", "camera", section=ADVANCED, since="0.4")
    eyes: Literal["ALIKE", "CALIBRATED"] = choice(
        "Eyes", "ALIKE", "Whether both eyes have the same camera. Truth and rectified images always belong to this "
        "parallel pair", "camera",
        ("ALIKE", "Alike", "Both eyes have this camera, with its distortion and toe-in"),
        ("CALIBRATED", "Calibrated", "Each eye has its own calibrated size, lens and direction, at the position that "
         "it has in this pair"),
        section=ALIGNMENT, since="0.4")
    principal_x_px: float = number(
        "Principal Point Right", 0.0, -8192.0, 8192.0, (-50.0, 50.0), "Distance of the optical axis to the right of "
        "the image centre", "camera", "px", subtype="PIXEL", section=LENS)
    principal_y_px: float = number(
        "Principal Point Down", 0.0, -8192.0, 8192.0, (-50.0, 50.0), "Distance of the optical axis below the image "
        "centre", "camera", "px", subtype="PIXEL", section=LENS)
    distortion_k1: float = number(
        "Distortion k1", 0.0, -10.0, 10.0, (-0.5, 0.5), "Radial distortion, r² term, in OpenCV's Brown-Conrady model. "
        "Negative values give barrel distortion", "response", precision=5, section=LENS, shown=ALIKE)
    distortion_k2: float = number(
        "Distortion k2", 0.0, -10.0, 10.0, (-0.5, 0.5), "Radial distortion, r⁴ term", "response", precision=5,
        section=LENS, shown=ALIKE)
    distortion_p1: float = number(
        "Distortion p1", 0.0, -10.0, 10.0, (-0.5, 0.5), "Tangential distortion, vertical decentring", "response",
        precision=5, section=LENS, shown=ALIKE)
    distortion_p2: float = number(
        "Distortion p2", 0.0, -10.0, 10.0, (-0.5, 0.5), "Tangential distortion, horizontal decentring", "response",
        precision=5, section=LENS, shown=ALIKE)
    distortion_k3: float = number(
        "Distortion k3", 0.0, -10.0, 10.0, (-0.5, 0.5), "Radial distortion, r⁶ term", "response", precision=5,
        section=LENS, shown=ALIKE)
    overscan: float = fraction(
        "Overscan", 0.0, "Margin that is rendered beyond each border, as a share of width and height. Lens distortion "
        "and toe-in need it", "camera", high=2.0, section=LENS)
    toe_in_deg: float = degrees(
        "Toe-in", 0.0, 0.0, 45.0, "Angle by which each eye turns toward the other, about its own vertical; 0 for "
        "parallel eyes", "camera", (0.0, 10.0), 3, section=ALIGNMENT, shown=ALIKE)
    focus_distance_m: float = metres(
        "Focus Distance", 0.0, 0.0, 1.0e5, (0.0, 10.0), "Depth that is in focus; 0 if everything is in focus. The "
        "f-number sets the blur, and the truth is always sharp", "camera", zero="all sharp", section=LENS)
    speed_right_m_s: float = number(
        "Speed Right (m/s)", 0.0, -1.0e4, 1.0e4, (-1.0, 1.0), "Motion of both eyes to the right during the exposure. "
        "It blurs the images; the truth is of the middle of the exposure", "camera", "m/s", section=MOTION)
    speed_down_m_s: float = number(
        "Speed Down (m/s)", 0.0, -1.0e4, 1.0e4, (-1.0, 1.0), "Motion of both eyes along the image's columns during "
        "the exposure. It blurs the images; the truth is of the middle of the exposure", "camera", "m/s",
        section=MOTION)
    speed_forward_m_s: float = number(
        "Speed Forward (m/s)", 0.0, -1.0e4, 1.0e4, (-1.0, 1.0), "Motion of both eyes along the optical axis during "
        "the exposure. It blurs the images; the truth is of the middle of the exposure", "camera", "m/s",
        section=MOTION)
    turn_right_deg_s: float = number(
        "Turn Right (°/s)", 0.0, -1.0e4, 1.0e4, (-30.0, 30.0), "Rotation of the rig to the right about the left eye "
        "during the exposure. It blurs the images; the truth is of the middle of the exposure", "camera", "deg/s",
        section=MOTION)
    turn_down_deg_s: float = number(
        "Turn Down (°/s)", 0.0, -1.0e4, 1.0e4, (-30.0, 30.0), "Rotation of the rig downward about the left eye during "
        "the exposure. It blurs the images; the truth is of the middle of the exposure", "camera", "deg/s",
        section=MOTION)
    roll_deg_s: float = number(
        "Roll (°/s)", 0.0, -1.0e4, 1.0e4, (-30.0, 30.0), "Rotation of the rig clockwise about the left eye's optical "
        "axis during the exposure. It blurs the images; the truth is of the middle of the exposure", "camera", "deg/s",
        section=MOTION)
    motion_exposure_s: float = number(
        "Exposure (s)", 0.0, 0.0, 1.0e5, (0.0, 1.0), "Exposure time for motion blur. 0 uses the exposure time of the "
        "camera response, which then must not be automatic", "camera", "s", precision=6, zero="camera's",
        section=MOTION, active=MOVES)
    readout_s: float = number(
        "Readout (s)", 0.0, 0.0, 1.0e5, (0.0, 0.1), "Rolling shutter: time from the first row's exposure to the last "
        "row's, top to bottom, in both eyes at once. Each row and its truth have the pose at its own time", "camera",
        "s", precision=6, zero="global", section=MOTION, since="0.4", active=MOVES)
    head_file: str = text(
        "Head File", "", "TOML file with further cameras, each with its model and pose; empty for no further cameras. "
        "// is the folder of the .blend file", "camera", "read", subtype="FILE_PATH", section=HEAD,
        since="0.4")
    images: Literal["PAIR", "HEAD"] = choice(
        "Images", "PAIR", "Which cameras are rendered", "camera",
        ("PAIR", "Pair", "Both eyes, and the cameras of the head file if it is set"),
        ("HEAD", "Head Only", "Only the cameras of the head file. Nothing is matched or evaluated"),
        section=HEAD, since="0.4")
    x_m: float = metres(
        "Camera East", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "East coordinate of the left camera", "camera",
        section=ADVANCED)
    y_m: float = metres(
        "Camera North", 0.0, -5.0e4, 5.0e4, (-10.0, 10.0), "North coordinate of the left camera", "camera",
        section=ADVANCED)
    height_from: Literal["GROUND", "ZERO"] = choice(
        "Height From", "GROUND", "Reference level of the left camera's height", "camera",
        ("GROUND", "Ground", "Height above Ground is above the ground beneath the camera"),
        ("ZERO", "Zero", "Height above Zero is exact. Height above Ground should be about right, since costs and "
         "search ranges use it"),
        section=ADVANCED, since="0.4")
    z_m: float = metres(
        "Height above Zero", 0.0, -1.0e5, 1.0e5, (-10.0, 10.0), "Height of the left camera above the zero of the site",
        "camera", section=ADVANCED, shown=chosen("height_from", "ZERO"), since="0.4")
    frame: int = number(
        "Frame", 0, 0, 10000000, (0, 100), "Number of this pair in a sequence; exports and reports follow it. Frames "
        "with one pose differ in their noise", "camera", section=ADVANCED, since="0.4")
    stamp: str = text(
        "Stamp (s)", "",
        "Time of the middle of the exposure in a sequence, in seconds with up to nine decimals; empty without"
        " a sequence. No image depends on it", "camera", "decimal", section=ADVANCED, since="0.4")


class CalibrationErrorSettings(Table, label="Calibration Error", inside="rig", since="0.4"):
    """Assumed calibration minus the true one, for rectified images and measured depth. The truth does not change."""

    __slots__ = ()
    right_yaw_deg: float = degrees(
        "Right Eye's Yaw", 0.0, -10.0, 10.0, "Assumed minus true yaw of the right eye, positive to the right. "
        "Measured disparities fall by about f times the angle", "response", (-1.0, 1.0), 4)
    right_pitch_deg: float = degrees(
        "Right Eye's Pitch", 0.0, -10.0, 10.0, "Assumed minus true pitch of the right eye, positive down. "
        "Its rectified image sinks by about f times the angle", "response", (-1.0, 1.0), 4)
    right_roll_deg: float = degrees(
        "Right Eye's Roll", 0.0, -10.0, 10.0, "Assumed minus true roll of the right eye, positive clockwise. "
        "Its rectified image is turned clockwise by the angle", "response", (-1.0, 1.0), 4)
    right_column_px: float = number(
        "Right Principal Column", 0.0, -1000.0, 1000.0, (-5.0, 5.0), "Assumed minus true column of the right eye's "
        "principal point. Measured disparities rise by it", "response", "px", precision=4, subtype="PIXEL")
    right_row_px: float = number(
        "Right Principal Row", 0.0, -1000.0, 1000.0, (-5.0, 5.0), "Assumed minus true row of the right eye's principal "
        "point. Its rectified image rises by it", "response", "px", precision=4, subtype="PIXEL")
    right_focal_percent: float = number(
        "Right Focal Length (%)", 0.0, -50.0, 100.0, (-2.0, 2.0), "Assumed minus true focal length of the right eye, "
        "in % of the true one, added to the error of both eyes", "response", "%", precision=4)
    focal_percent: float = number(
        "Focal Lengths (%)", 0.0, -50.0, 100.0, (-2.0, 2.0), "Assumed minus true focal length of both eyes, in % of "
        "the true one. Measured depth changes by it", "response", "%", precision=4)
    baseline_percent: float = number(
        "Baseline (%)", 0.0, -90.0, 900.0, (-2.0, 2.0), "Assumed minus true baseline, in % of the true one. Measured "
        "depth changes by it", "response", "%", precision=4)
    right_k1: float = number(
        "Right Distortion k1", 0.0, -1.0, 1.0, (-0.05, 0.05), "Assumed minus true k1 of the right eye's lens, added "
        "to the error of both lenses", "response", precision=5)
    k1: float = number(
        "Distortion k1", 0.0, -1.0, 1.0, (-0.05, 0.05), "Assumed minus true k1 of both lenses", "response",
        precision=5)


class EyeSettings(Table, since="0.4"):
    """A calibrated camera. Pixels are counted from the centre of the first pixel, as calibrations count them."""

    __slots__ = ()
    width_px: int = number(
        "Image Width", 640, 4, 16384, (64, 2048), "Columns of the images of this eye", "camera", "px", subtype="PIXEL")
    height_px: int = number(
        "Image Height", 480, 4, 16384, (64, 2048), "Rows of the images of this eye", "camera", "px", subtype="PIXEL")
    fx_px: float = number(
        "Focal Length x", 341.33334, 1.0, 1.0e6, (50.0, 5000.0), "Focal length along rows, in pixels", "camera", "px",
        subtype="PIXEL")
    fy_px: float = number(
        "Focal Length y", 341.33334, 1.0, 1.0e6, (50.0, 5000.0), "Focal length along columns, in pixels", "camera",
        "px", subtype="PIXEL")
    cx_px: float = number(
        "Principal Column", 319.5, -1.0e5, 1.0e5, (0.0, 2048.0), "Column of the principal point, from the centre of "
        "the first pixel", "camera", "px", subtype="PIXEL")
    cy_px: float = number(
        "Principal Row", 239.5, -1.0e5, 1.0e5, (0.0, 2048.0), "Row of the principal point, from the centre of the "
        "first pixel", "camera", "px", subtype="PIXEL")
    skew_px: float = number(
        "Skew", 0.0, -1.0e4, 1.0e4, (-10.0, 10.0),
        "Shift to the right, in columns, of a point one focal length below the principal point",
        "camera", "px", subtype="PIXEL", section=ADVANCED)
    turn_x_deg: float = degrees(
        "Turn about x", 0.0, -180.0, 180.0, "Component along x, to the right, of the rotation vector from the axes of "
        "the parallel pair to those of the eye (x right, y down, z ahead)", "camera", (-45.0, 45.0), 4, section=TURN)
    turn_y_deg: float = degrees(
        "Turn about y", 0.0, -180.0, 180.0,
        "Component along y, down, of the same rotation vector. It is negative for a left eye that looks "
        "toward the right one", "camera", (-45.0, 45.0), 4, section=TURN)
    turn_z_deg: float = degrees(
        "Turn about z", 0.0, -180.0, 180.0,
        "Component along z, ahead, of the same rotation vector. It is negative for an eye that is turned "
        "clockwise", "camera", (-45.0, 45.0), 4, section=TURN)
    lens: Literal["BROWN", "FISHEYE", "CAHVORE"] = choice(
        "Lens", "BROWN", "Model of the lens", "camera",
        ("BROWN", "Brown-Conrady", "Polynomials of the tangents: OpenCV's lens with 5, 8 or 12 coefficients"),
        ("FISHEYE", "Fisheye", "A polynomial of the angle, with four coefficients (Kannala and Brandt)"),
        ("CAHVORE", "CAHVORE", "JPL's lens; CAHVOR if it is a perspective lens"))
    k1: float = number(
        "k1", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient k1",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN", "FISHEYE"))
    k2: float = number(
        "k2", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient k2",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN", "FISHEYE"))
    p1: float = number(
        "p1", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Tangential coefficient p1, vertical decentring",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN"))
    p2: float = number(
        "p2", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Tangential coefficient p2, horizontal decentring",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN"))
    k3: float = number(
        "k3", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient k3",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN", "FISHEYE"))
    k4: float = number(
        "k4", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5),
        "Radial coefficient k4; the first in the denominator of Brown-Conrady",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN", "FISHEYE"))
    k5: float = number(
        "k5", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient k5, in the denominator",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN"))
    k6: float = number(
        "k6", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient k6, in the denominator",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "BROWN"))
    s1: float = number(
        "s1", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient of a thin prism: columns, r²",
        "camera", precision=6, section=PRISM, shown=chosen("lens", "BROWN"))
    s2: float = number(
        "s2", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient of a thin prism: columns, r⁴",
        "camera", precision=6, section=PRISM, shown=chosen("lens", "BROWN"))
    s3: float = number(
        "s3", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient of a thin prism: rows, r²",
        "camera", precision=6, section=PRISM, shown=chosen("lens", "BROWN"))
    s4: float = number(
        "s4", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient of a thin prism: rows, r⁴",
        "camera", precision=6, section=PRISM, shown=chosen("lens", "BROWN"))
    axis_x: float = number(
        "Axis Right", 0.0, -0.9, 0.9, (-0.1, 0.1),
        "x component of the optical axis O, a unit vector in the axes of the eye",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    axis_y: float = number(
        "Axis Down", 0.0, -0.9, 0.9, (-0.1, 0.1), "y component of the optical axis O", "camera", precision=6,
        section=MODEL, shown=chosen("lens", "CAHVORE"))
    r0: float = number(
        "R0", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient R0",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    r1: float = number(
        "R1", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient R1",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    r2: float = number(
        "R2", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Radial coefficient R2",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    e0: float = number(
        "E0", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient E0 of the entrance pupil",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    e1: float = number(
        "E1", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient E1 of the entrance pupil",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    e2: float = number(
        "E2", 0.0, -1.0e6, 1.0e6, (-0.5, 0.5), "Coefficient E2 of the entrance pupil",
        "camera", precision=6, section=MODEL, shown=chosen("lens", "CAHVORE"))
    linearity: float = number(
        "Linearity", 1.0, -2.0, 2.0, (-1.0, 1.0), "Kind of lens, from perspective at 1 to fisheye at 0", "camera",
        section=MODEL, shown=chosen("lens", "CAHVORE"))


class LeftEyeSettings(EyeSettings, label="Left Eye", inside="rig", shown=CALIBRATED):
    """The calibrated left eye, at the left centre of the parallel pair."""

    __slots__ = ()


class RightEyeSettings(EyeSettings, label="Right Eye", inside="rig", shown=CALIBRATED):
    """The calibrated right eye, at the right centre of the parallel pair."""

    __slots__ = ()


class SensorSettings(Table, label="Exposure and Sensor", brief="Exposure"):
    """From radiance to digital numbers (EMVA 1288). Changes need no new render."""

    __slots__ = ()
    auto_exposure: bool = tick(
        "Auto Exposure", True, "Set the exposure of both eyes from the brightest part of the left image", "response")
    auto_percentile: float = fraction(
        "Auto Percentile", 0.99, "Share of the pixels that are at or below the exposure target", "response",
        section=ADVANCED, shown=ticked("auto_exposure"))
    auto_target: float = fraction(
        "Auto Target", 0.8, "Exposure target as a share of the full well, divided by the gain if that is above 1",
        "response", low=0.01, section=ADVANCED, shown=ticked("auto_exposure"))
    exposure_s: float = number(
        "Exposure (s)", 1.0e-3, 1.0e-7, 1.0e5, (1.0e-5, 1.0), "Exposure time when auto exposure is off", "response",
        "s", precision=6, shown=~ticked("auto_exposure"))
    brackets: int = number(
        "Merged Exposures", 1, 1, 9, None, "Number of exposures that are merged into one image (HDR); 1 for no merging",
        "response", "exposures")
    bracket_stops: float = number(
        "Exposure Step (stops)", 2.0, 0.1, 8.0, (0.5, 4.0), "Step between successive exposures, as a power of two. "
        "They are centred on the exposure", "response", "stops", section=ADVANCED, active=BRACKETED)
    encoding: Literal["LINEAR", "SQUARE_ROOT"] = choice(
        "8-bit Encoding", "LINEAR", "Reduction of images with more than 8 bits to 8 bits for matchers", "response",
        ("LINEAR", "Linear", "Keep the top bits"),
        ("SQUARE_ROOT", "Square Root", "Equal steps of shot noise, as in images that rovers send"))
    f_number: float = number(
        "f-Number", 8.0, 0.5, 256.0, (1.0, 32.0), "Focal length divided by the diameter of the aperture", "response",
        section=OPTICS)
    pixel_pitch_um: float = number(
        "Pixel Pitch (µm)", 0.0, 0.0, 1000.0, (0.0, 30.0), "Side of a pixel, which sets how much light and how many "
        "particles it receives; 0 for sensor width / columns", "response", "µm", precision=2, zero="by sensor",
        section=OPTICS, since="0.2")
    transmission: float = fraction(
        "Transmission", 0.9, "Share of the light that lens and filter transmit", "response", section=OPTICS)
    band_centre_nm: float = number(
        "Band Centre (nm)", 600.0, 100.0, 2.0e4, (300.0, 1100.0), "Centre of the band that a monochrome sensor detects",
        "response", "nm", precision=0, section=OPTICS, shown=chosen("colour", "MONO"))
    band_width_nm: float = number(
        "Band Width (nm)", 200.0, 0.1, 2.0e4, (5.0, 700.0), "Width of the band that a monochrome sensor detects",
        "response", "nm", precision=0, section=OPTICS, shown=chosen("colour", "MONO"))
    quantum_efficiency: float = fraction(
        "Quantum Efficiency", 0.5, "Mean number of electrons per photon in the band of a monochrome sensor",
        "response", section=DETECTOR, shown=chosen("colour", "MONO"))
    band_weights: Literal["EQUAL", "BAND"] = choice(
        "Weights of R, G, B", "EQUAL",
        "Weights with which a monochrome camera adds the bands of the pair. Grey ground looks the same with both "
        "choices", "response",
        ("EQUAL", "Equal", "The mean of R, G and B"),
        ("BAND", "By the Band",
            "The sunlight of each band within the camera's band, so brown ground is brighter in a red camera"),
        section=OPTICS, shown=chosen("colour", "MONO"), since="0.3")
    colour: Literal["MONO", "BAYER"] = choice(
        "Sensor Type", "MONO", "Whether the camera sees colour. Both types use the same render", "response",
        ("MONO", "Monochrome", "Each pixel detects the whole band"),
        ("BAYER", "Colour (Bayer)", "Each pixel is behind a red, green or blue filter, and the other two colours "
         "come from its neighbours. Matchers get a grey image of all three"),
        since="0.3")
    bayer_pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"] = choice(
        "Bayer Pattern", "RGGB", "Colours of the first two pixels of the first two rows", "response",
        ("RGGB", "RGGB", "First row RG, second row GB"),
        ("BGGR", "BGGR", "First row BG, second row GR"),
        ("GRBG", "GRBG", "First row GR, second row BG"),
        ("GBRG", "GBRG", "First row GB, second row RG"),
        section=MOSAICKING, since="0.3")
    demosaicing: Literal["BILINEAR", "MALVAR", "EDGE_AWARE"] = choice(
        "Demosaicing", "MALVAR", "Method that finds the two missing colours of each pixel", "response",
        ("BILINEAR", "Bilinear", "Mean of the nearest pixels of a colour. The softest"),
        ("MALVAR", "Malvar", "Linear, with the detail of the pixel's own colour (Malvar, He and Cutler 2004), as on "
         "Mars rovers"),
        ("EDGE_AWARE", "Edge-Aware", "Green along edges, not across them; red and blue as Bilinear (OpenCV). The "
         "pair viewer shows Malvar instead"),
        section=MOSAICKING, since="0.3")
    white_balance: Literal["SUN", "NONE"] = choice(
        "White Balance", "SUN", "Factors on red, green and blue after demosaicing", "response",
        ("SUN", "Sunlight", "Multiplies the weaker colours so that white ground in sunlight is grey"),
        ("NONE", "None", "Keeps the numbers of the sensor"),
        section=MOSAICKING, since="0.3")
    grey: Literal["LUMINANCE", "MEAN"] = choice(
        "Grey for Matchers", "LUMINANCE", "Conversion of a colour image to grey for matchers", "response",
        ("LUMINANCE", "Luminance", "0.2126 red + 0.7152 green + 0.0722 blue (ITU-R BT.709), linear"),
        ("MEAN", "Mean", "A third of each"),
        section=MOSAICKING, since="0.3")
    red_centre_nm: float = number(
        "Red Centre (nm)", 615.0, 100.0, 2.0e4, (380.0, 720.0), "Wavelength at which the red filter passes most, with "
        "a Gaussian around it", "response", "nm", precision=0, section=FILTERS, since="0.3")
    red_half_width_nm: float = number(
        "Red Half Width (nm)", 45.0, 0.1, 2.0e4, (10.0, 100.0), "Distance from the centre of the red filter at which "
        "half is passed", "response", "nm", precision=0, section=FILTERS, since="0.3")
    red_efficiency: float = fraction(
        "Red Efficiency", 0.46, "Electrons per photon at the centre of the red filter, besides its leak", "response",
        section=FILTERS, since="0.3")
    green_centre_nm: float = number(
        "Green Centre (nm)", 535.0, 100.0, 2.0e4, (380.0, 720.0), "Wavelength at which the green filter passes most, "
        "with a Gaussian around it", "response", "nm", precision=0, section=FILTERS, since="0.3")
    green_half_width_nm: float = number(
        "Green Half Width (nm)", 46.0, 0.1, 2.0e4, (10.0, 100.0), "Distance from the centre of the green filter at "
        "which half is passed", "response", "nm", precision=0, section=FILTERS, since="0.3")
    green_efficiency: float = fraction(
        "Green Efficiency", 0.55, "Electrons per photon at the centre of the green filter, besides its leak",
        "response", section=FILTERS, since="0.3")
    blue_centre_nm: float = number(
        "Blue Centre (nm)", 450.0, 100.0, 2.0e4, (380.0, 720.0), "Wavelength at which the blue filter passes most, "
        "with a Gaussian around it", "response", "nm", precision=0, section=FILTERS, since="0.3")
    blue_half_width_nm: float = number(
        "Blue Half Width (nm)", 50.0, 0.1, 2.0e4, (10.0, 100.0), "Distance from the centre of the blue filter at "
        "which half is passed", "response", "nm", precision=0, section=FILTERS, since="0.3")
    blue_efficiency: float = fraction(
        "Blue Efficiency", 0.51, "Electrons per photon at the centre of the blue filter, besides its leak", "response",
        section=FILTERS, since="0.3")
    filter_leak: float = fraction(
        "Filter Leak", 0.04, "Electrons per photon that every colour filter adds at all wavelengths that reach it",
        "response", section=MOSAICKING, since="0.3")
    cut_on_nm: float = number(
        "Cut-On (nm)", 400.0, 100.0, 2.0e4, (350.0, 450.0), "Shortest wavelength that reaches the colour filters",
        "response", "nm", precision=0, section=MOSAICKING, since="0.3")
    cut_off_nm: float = number(
        "Cut-Off (nm)", 700.0, 100.0, 2.0e4, (620.0, 750.0),
        "Longest wavelength that reaches the colour filters, set by an infrared cut-off filter",
        "response", "nm", precision=0, section=MOSAICKING, since="0.3")
    full_well_e: float = number(
        "Full Well (e-)", 2.0e4, 1.0, 1.0e7, (1000.0, 1.0e5), "Electrons that a pixel can hold before it saturates",
        "response", "e-", precision=0, section=DETECTOR)
    gain: float = number(
        "Gain", 1.0, 0.01, 1000.0, (0.5, 16.0),
        "Gain, relative to the gain at which a full well gives the largest number", "response", section=DETECTOR)
    read_noise_e: float = number(
        "Read Noise (e-)", 15.0, 0.0, 1.0e5, (0.0, 100.0), "Standard deviation of the noise from reading a pixel",
        "response", "e-", precision=1, section=NOISE)
    row_noise_e: float = number(
        "Row Noise (e-)", 0.0, 0.0, 1.0e5, (0.0, 20.0), "Standard deviation of the noise that all pixels of a row "
        "share, new in each exposure", "response", "e-", precision=1, section=NOISE, since="0.3")
    shot_noise: bool = tick(
        "Shot Noise", True, "Poisson noise of photo-electrons and dark current", "response", section=NOISE)
    dark_current_e_s: float = number(
        "Dark Current (e-/s)", 10.0, 0.0, 1.0e7, (0.0, 1000.0), "Electrons per second without light at the reference "
        "temperature", "response", "e-/s", section=NOISE)
    temperature_k: float = number(
        "Temperature (K)", 253.0, 0.0, 500.0, (150.0, 330.0), "Temperature of the sensor, which changes the dark "
        "current", "response", "K", precision=0, section=NOISE)
    dark_reference_k: float = number(
        "Dark Reference (K)", 293.0, 1.0, 500.0, (200.0, 330.0), "Temperature for which the dark current is given",
        "response", "K", precision=0, section=NOISE)
    dark_doubling_k: float = number(
        "Dark Doubling (K)", 8.0, 1.0, 50.0, (4.0, 12.0), "Rise in temperature that doubles the dark current",
        "response", "K", precision=1, section=NOISE)
    prnu: float = fraction(
        "PRNU", 0.0, "Photo-response non-uniformity: standard deviation of the pixels' sensitivity", "response",
        section=NOISE)
    dsnu_e: float = number(
        "DSNU (e-)", 0.0, 0.0, 1.0e5, (0.0, 100.0), "Dark-signal non-uniformity: standard deviation of the pixels' "
        "offsets", "response", "e-", precision=1, section=NOISE)
    blooming: float = fraction(
        "Blooming", 0.0, "Share of a full well's overflow that spreads along the column. The rest is drained",
        "response", section=DETECTOR)
    black_level: float = fraction(
        "Black Level", 0.0, "Number that is read without light, as a share of the converter's range", "response",
        high=0.5, section=DETECTOR)
    bits: int = number(
        "Bits", 8, 8, 16, None, "Bits of the analogue-to-digital converter", "response", "bits", section=DETECTOR)
    psf_sigma_px: float = number(
        "Point Spread (px)", 0.0, 0.0, 50.0, (0.0, 3.0), "Standard deviation of the lens's Gaussian point spread",
        "response", "px", precision=2, section=OPTICS)
    veiling_glare: float = fraction(
        "Veiling Glare", 0.0, "Share of the light that is spread evenly over the image (ISO 9358)", "response",
        section=OPTICS)
    deposit_share: float = fraction(
        "Lens Deposits", 0.0, "Share of the window before each lens that dust or frost covers", "response", high=0.95,
        section=DEPOSITS, since="0.3")
    deposit_mm: float = number(
        "Deposit Grain (mm)", 0.5, 0.01, 50.0, (0.05, 5.0), "Diameter of a grain or flake on the window", "response",
        "mm", section=DEPOSITS, since="0.3")
    deposit_window_mm: float = number(
        "Window Distance (mm)", 20.0, 0.1, 1000.0, (5.0, 100.0),
        "Distance of the window from the entrance pupil of the lens. A nearer window has wider and fainter spots",
        "response", "mm", section=DEPOSITS, since="0.3")
    deposit_scatter: float = fraction(
        "Scattered Share", 0.3, "Share of the blocked light that the deposits scatter evenly over the image",
        "response", section=DEPOSITS, since="0.3")
    deposit_seed: int = number(
        "Deposit Seed", 0, 0, 1000000, (0, 100), "Seed of the deposits. Another seed puts them elsewhere", "response",
        section=DEPOSITS, since="0.3")
    deposits_alike: bool = tick(
        "Same in Both Eyes", False, "Put the deposits at the same places in front of both lenses", "response",
        section=DEPOSITS,
        since="0.3")
    radiation_flux_cm2_s: float = number(
        "Particles (1/cm² s)", 0.0, 0.0, 1.0e12, (0.0, 1.0e6), "Charged particles that reach the sensor, per cm² and "
        "second", "response", "1/(cm² s)", precision=0, section=RADIATION)
    radiation_depth_um: float = number(
        "Sensitive Depth (µm)", 10.0, 0.1, 1000.0, (2.0, 50.0), "Depth of silicon in which particles release electrons",
        "response", "µm", precision=1, section=RADIATION, active=positive("radiation_flux_cm2_s"))
    radiation_e_per_um: float = number(
        "Ionisation (e-/µm)", 80.0, 0.0, 1.0e6, (50.0, 500.0), "Electrons that a particle releases per micrometre",
        "response", "e-/µm", precision=0, section=RADIATION, active=positive("radiation_flux_cm2_s"))
    noise_seed: int = number(
        "Noise Seed", 0, 0, 2147483647, (0, 100), "Seed of the noise. Another seed gives other noise of the same "
        "sensor", "response", section=NOISE)
