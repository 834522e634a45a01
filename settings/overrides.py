"""Changes of some settings as types: ``{"rig": {"width_px": 640}}`` with keys and values that the type checker knows.

What follows ``MADE FROM HERE ON`` is written by ``python -m icymoon.settings.make_types``; a test compares.
"""

from __future__ import annotations

from typing import Literal, TypedDict

# MADE FROM HERE ON


class SourceOverrides(TypedDict, total=False):
    """Changes of ``source``."""

    kind: Literal["PROCEDURAL", "MESH", "STAND_IN", "HEIGHT_MAP"]
    stand_in: Literal[
        "ATHABASCA",
        "GLACIER_42M",
        "BLOODFALLS",
        "SEAICE1",
        "MATANUSKA_A1",
        "MATANUSKA_C1",
        "SVALBARD1",
        "GAEA_RIDGY",
        "GAEA_ROCKY_PERLIN",
        "GAEA_ROCKY",
        "MATANUSKA_PLAYGROUND",
    ]
    file: str
    scale: float  # m/unit
    up_axis: Literal["AUTO", "X", "Y", "Z", "-X", "-Y", "-Z"]
    centre: bool
    origin_x_m: float  # m
    origin_y_m: float  # m
    metres_per_pixel: float  # m
    missing: str
    height_scale_m: float  # m
    detail: bool
    repair: bool


class TerrainLayerOverrides(TypedDict, total=False):
    """Changes of ``terrain``."""

    basis: Literal["GRADIENT", "MIDPOINT", "CELLS", "VORONOI_F1", "VORONOI_F2", "VORONOI_F2_F1", "CRACKLE"]
    fractal: Literal["FBM", "MULTIFRACTAL", "HYBRID", "RIDGED", "HETERO", "TURBULENCE", "CRESTS"]
    amplitude_m: float  # m
    scale_m: float  # m
    octaves: int  # octaves
    lacunarity: float
    roughness: float
    warp_m: float  # m


class TerrainOverrides(TypedDict, total=False):
    """Changes of ``terrain``."""

    size_m: float  # m
    resolution: int  # vertices
    rms_slope_deg: float  # deg
    slope_baseline_m: float  # m
    hurst: float
    multifractality: float
    outer_scale_m: float  # m
    inner_scale_m: float  # m
    lacunarity: float
    regional_slope_deg: float  # deg
    regional_slope_azimuth_deg: float  # deg
    body_radius_m: float  # m
    variant: int
    layers: list[TerrainLayerOverrides]


class MeshOverrides(TypedDict, total=False):
    """Changes of ``mesh``."""

    kind: Literal["GRADED", "GRID"]
    error_px: float  # px
    edge_px: float  # px
    farthest_m: float  # m
    most: int  # vertices
    seen: Literal["EVEN", "FINE"]
    crests: Literal["ROUNDED", "CUT"]
    walls: Literal["FLUTED", "BROKEN"]


class RidgesOverrides(TypedDict, total=False):
    """Changes of ``ridges``."""

    height_m: float  # m
    width_m: float  # m
    spacing_m: float  # m
    trough: float
    sets: int  # sets
    azimuth_deg: float  # deg
    spread_deg: float  # deg


class CracksOverrides(TypedDict, total=False):
    """Changes of ``cracks``."""

    depth_m: float  # m
    width_m: float  # m
    rim_m: float  # m
    plate_m: float  # m
    elongation: float
    azimuth_deg: float  # deg
    edges: Literal["ROUNDED", "BROKEN"]


class ChaosOverrides(TypedDict, total=False):
    """Changes of ``chaos``."""

    relief_m: float  # m
    plate_m: float  # m
    plate_share: float
    gap_m: float  # m
    tilt_deg: float  # deg
    matrix_m: float  # m
    edges: Literal["ROUNDED", "BROKEN"]


class CratersOverrides(TypedDict, total=False):
    """Changes of ``craters``."""

    coverage: float
    smallest_m: float  # m
    largest_m: float  # m
    power_index: float
    depth_ratio: float
    rim_ratio: float
    freshness: float
    most: int  # craters


class HollowsOverrides(TypedDict, total=False):
    """Changes of ``hollows``."""

    depth_m: float  # m
    diameter_m: float  # m
    elongation: float
    azimuth_deg: float  # deg
    crest_m: float  # m


class PenitentesOverrides(TypedDict, total=False):
    """Changes of ``penitentes``."""

    height_m: float  # m
    spacing_m: float  # m
    sharpness: float
    elongation: float
    variation: float
    disorder: float
    noon_azimuth_deg: float  # deg
    lean_deg: float  # deg


class PitsOverrides(TypedDict, total=False):
    """Changes of ``pits``."""

    depth_m: float  # m
    diameter_m: float  # m
    coverage: float
    wall_deg: float  # deg
    talus: float


class HillsOverrides(TypedDict, total=False):
    """Changes of ``hills``."""

    rms_slope_deg: float  # deg
    slope_baseline_m: float  # m
    hurst: float
    largest_m: float  # m
    smallest_m: float  # m
    fractal: Literal["FBM", "CRESTS", "HETERO"]


class MantleOverrides(TypedDict, total=False):
    """Changes of ``mantle``."""

    thickness_m: float  # m
    length_m: float  # m


class ExcavationOverrides(TypedDict, total=False):
    """Changes of ``excavation``."""

    path: Literal["NONE", "LINE", "ARC", "RECORDED", "JOINTS"]
    state: int  # states
    states: int  # states
    file: str
    start_x_m: float  # m
    start_y_m: float  # m
    heading_deg: float  # deg
    length_m: float  # m
    width_m: float  # m
    bite_m: float  # m
    radius_m: float  # m
    cohesion_pa: float  # Pa
    friction_deg: float  # deg
    density_kg_m3: float  # kg/m³
    bulking: float
    gravity_m_s2: float  # m/s²
    chips_m: float  # m
    heaped_share: float
    heap_side: Literal["LEFT", "RIGHT"]
    heap_gap_m: float  # m
    clods_m: float  # m
    clod_sizes: Literal["ONE", "MANY"]
    cell_m: float  # m
    fresh_albedo: float
    layer_thickness_m: float  # m
    layer_depth_m: float  # m
    layer_spacing_m: float  # m
    layer_albedo: float
    jitter_m: float  # m
    jitter_deg: float  # deg


class SurfaceOverrides(TypedDict, total=False):
    """Changes of ``surface``."""

    model: Literal["PRINCIPLED", "LAMBERT", "LOMMEL_SEELIGER", "LUNAR_LAMBERT", "HAPKE", "SNOW"]
    albedo: float
    lommel_seeliger_share: float
    ice_colour: Literal["GREY", "SNOW", "EUROPA_PLAINS", "ENCELADUS_PLAINS"]
    snow_grain_m: float  # m
    albedo_variation: float
    face_variation: float
    albedo_patch_m: float  # m
    trough_dirt: float
    slope_dirt: float
    dirt: Literal["BLACK", "EUROPA_DARK", "SULPHUR", "THOLIN"]
    dirt_patch_m: float  # m
    salt_share: float
    salt_patch_m: float  # m
    salt: Literal["OWN", "EUROPA_SALT", "IRRADIATED_SALT", "SULPHATE_SALTS", "ACID_HYDRATE", "SULPHUR", "EUROPA_DARK"]
    salt_red: float
    salt_green: float
    salt_blue: float
    subsurface_weight: float
    subsurface_radius_m: float  # m
    subsurface_method: Literal["RANDOM_WALK", "BURLEY"]
    transmission: float
    transmitted: Literal["LOST", "THROUGH"]
    roughness: float
    specular: float
    refractive_index: float
    bubble_share: float
    bubble_radius_m: float  # m
    bubble_band_m: float  # m
    fracture_share: float
    fracture_spacing_m: float  # m
    frost_share: float
    frost_patch_m: float  # m
    patch_raggedness: float
    frost_albedo: float
    crust_share: float
    crust_patch_m: float  # m
    crust_height_m: float  # m
    crust_roughness: float
    glint_share: float
    glint_size_m: float  # m
    grain_size_m: float  # m
    grain_amplitude_m: float  # m
    grain_patchiness: float
    relief: Literal["BUMP", "DISPLACEMENT", "REAL"]


class HapkeOverrides(TypedDict, total=False):
    """Changes of ``hapke``."""

    w: float
    b: float
    c: float
    b_s0: float
    h_s: float
    b_c0: float
    h_c: float
    theta_bar_deg: float  # deg
    theta_bar_range_deg: float  # deg
    filling_factor: float
    h_function: Literal["1981", "1993", "2002"]
    accuracy: Literal["FAST", "ACCURATE", "REFERENCE"]
    backend: Literal["AUTO", "OSL", "NODES"]


class TexturesOverrides(TypedDict, total=False):
    """Changes of ``textures``."""

    set: Literal["NONE", "FROST", "GRAINS", "CRACKS", "STAND_IN", "OWN", "MESH"]
    stand_in: Literal[
        "SNOW_CRYSTALS",
        "HOAR_FROST",
        "SNOW_DRIFT",
        "CRUSTED_SNOW",
        "CRACKED_ICE",
        "POWDER_SNOW",
        "GROUND_SNOW",
        "LUMPY_SNOW",
        "FIRN",
        "GLACIER_ICE",
        "MIXED_SNOW",
        "SETTLED_SNOW",
        "SUNCUPS",
        "SASTRUGI",
    ]
    mapping: Literal["OBJECT", "UV", "PATCH"]
    width_m: float  # m
    repeat: Literal["TURNED", "SHIFTED", "PLAIN"]
    height_m: float  # m
    albedo_file: str
    roughness_file: str
    normal_file: str
    transmission_file: str
    height_file: str


class RocksOverrides(TypedDict, total=False):
    """Changes of ``rocks``."""

    law: Literal["POWER", "GOLOMBEK", "TABLE"]
    file: str
    coverage: float
    smallest_m: float  # m
    largest_m: float  # m
    power_index: float
    family: Literal["MIXED", "FRAGMENTS", "BOULDERS", "SLABS", "BROKEN_ICE"]
    angularity: float
    elongation: float
    height_ratio: float
    tilt_deg: float  # deg
    burial: float
    clustering: float
    cluster_blocks: float  # rocks
    cluster_radius_m: float  # m
    clear_radius_m: float  # m
    most: int  # rocks
    beyond_px: float  # px
    own_surface: bool


class RockSurfaceOverrides(TypedDict, total=False):
    """Changes of ``rock_surface``."""

    model: Literal["PRINCIPLED", "LAMBERT", "LOMMEL_SEELIGER", "LUNAR_LAMBERT", "HAPKE", "SNOW"]
    albedo: float
    lommel_seeliger_share: float
    ice_colour: Literal["GREY", "SNOW", "EUROPA_PLAINS", "ENCELADUS_PLAINS"]
    snow_grain_m: float  # m
    albedo_variation: float
    face_variation: float
    albedo_patch_m: float  # m
    trough_dirt: float
    slope_dirt: float
    dirt: Literal["BLACK", "EUROPA_DARK", "SULPHUR", "THOLIN"]
    dirt_patch_m: float  # m
    salt_share: float
    salt_patch_m: float  # m
    salt: Literal["OWN", "EUROPA_SALT", "IRRADIATED_SALT", "SULPHATE_SALTS", "ACID_HYDRATE", "SULPHUR", "EUROPA_DARK"]
    salt_red: float
    salt_green: float
    salt_blue: float
    subsurface_weight: float
    subsurface_radius_m: float  # m
    subsurface_method: Literal["RANDOM_WALK", "BURLEY"]
    transmission: float
    transmitted: Literal["LOST", "THROUGH"]
    roughness: float
    specular: float
    refractive_index: float
    bubble_share: float
    bubble_radius_m: float  # m
    bubble_band_m: float  # m
    fracture_share: float
    fracture_spacing_m: float  # m
    frost_share: float
    frost_patch_m: float  # m
    patch_raggedness: float
    frost_albedo: float
    crust_share: float
    crust_patch_m: float  # m
    crust_height_m: float  # m
    crust_roughness: float
    glint_share: float
    glint_size_m: float  # m
    grain_size_m: float  # m
    grain_amplitude_m: float  # m
    grain_patchiness: float
    relief: Literal["BUMP", "DISPLACEMENT", "REAL"]


class LightOverrides(TypedDict, total=False):
    """Changes of ``light``."""

    directions_from: Literal["ANGLES", "DATE", "KERNELS"]
    body: str
    parent: str
    date_utc: str
    latitude_deg: float  # deg
    longitude_deg: float  # deg
    kernels: str
    sun_irradiance_wm2: float  # W/m²
    sun_angular_diameter_deg: float  # deg
    irradiance_band: Literal["BOLOMETRIC", "CAMERA"]
    sun_scale: float
    planet_scale: float
    sun_temperature_k: float  # K
    sun_elevation_deg: float  # deg
    sun_azimuth_deg: float  # deg
    sun_distance_m: float  # m
    planet: bool
    planet_elevation_deg: float  # deg
    planet_azimuth_deg: float  # deg
    planet_angular_diameter_deg: float  # deg
    planet_flattening: float
    planet_albedo: float
    planet_phase_law: Literal["LAMBERT", "SATURN", "JUPITER"]
    planet_least: float
    planet_rings: bool
    planet_face: Literal["PLAIN", "SATURN", "JUPITER"]
    planet_spot_longitude_deg: float  # deg
    stars: bool
    stars_faintest_mag: float  # mag


class RigOverrides(TypedDict, total=False):
    """Changes of ``rig``."""

    baseline_m: float  # m
    focal_length_mm: float  # mm
    sensor_width_mm: float  # mm
    width_px: int  # px
    height_px: int  # px
    height_m: float  # m
    pitch_deg: float  # deg
    heading_deg: float  # deg
    principal_x_px: float  # px
    principal_y_px: float  # px
    distortion_k1: float
    distortion_k2: float
    distortion_p1: float
    distortion_p2: float
    distortion_k3: float
    overscan: float
    toe_in_deg: float  # deg
    focus_distance_m: float  # m
    speed_right_m_s: float  # m/s
    speed_down_m_s: float  # m/s
    speed_forward_m_s: float  # m/s
    turn_right_deg_s: float  # deg/s
    turn_down_deg_s: float  # deg/s
    roll_deg_s: float  # deg/s
    motion_exposure_s: float  # s
    x_m: float  # m
    y_m: float  # m


class LanderOverrides(TypedDict, total=False):
    """Changes of ``lander``."""

    kind: Literal["NONE", "PARAMETRIC", "OWN"]
    file: str
    joints: str
    turn_deg: float  # deg
    deck_front_m: float  # m
    deck_width_m: float  # m
    deck_height_m: float  # m
    pad_ahead_m: float  # m
    pad_apart_m: float  # m
    pad_diameter_m: float  # m
    pad_sink_m: float  # m
    frost_share: float


class ArmOverrides(TypedDict, total=False):
    """Changes of ``arm``."""

    yaw_deg: float  # deg
    shoulder_deg: float  # deg
    elbow_deg: float  # deg
    wrist_deg: float  # deg
    roll_deg: float  # deg
    yaw_offset_deg: float  # deg
    shoulder_offset_deg: float  # deg
    elbow_offset_deg: float  # deg
    wrist_offset_deg: float  # deg
    roll_offset_deg: float  # deg
    yaw_low_deg: float  # deg
    yaw_high_deg: float  # deg
    shoulder_low_deg: float  # deg
    shoulder_high_deg: float  # deg
    elbow_low_deg: float  # deg
    elbow_high_deg: float  # deg
    wrist_low_deg: float  # deg
    wrist_high_deg: float  # deg
    roll_low_deg: float  # deg
    roll_high_deg: float  # deg
    shoulder_x_m: float  # m
    shoulder_y_m: float  # m
    shoulder_z_m: float  # m
    offset_m: float  # m
    upper_m: float  # m
    fore_m: float  # m
    hand_m: float  # m
    scoop_length_m: float  # m
    scoop_width_m: float  # m
    scoop_depth_m: float  # m


class WorkspaceOverrides(TypedDict, total=False):
    """Changes of ``workspace``."""

    cell_m: float  # m
    east_m: float  # m
    north_m: float  # m
    size_m: float  # m


class SensorOverrides(TypedDict, total=False):
    """Changes of ``sensor``."""

    auto_exposure: bool
    auto_percentile: float
    auto_target: float
    exposure_s: float  # s
    brackets: int  # exposures
    bracket_stops: float  # stops
    encoding: Literal["LINEAR", "SQUARE_ROOT"]
    f_number: float
    pixel_pitch_um: float  # µm
    transmission: float
    band_centre_nm: float  # nm
    band_width_nm: float  # nm
    quantum_efficiency: float
    band_weights: Literal["EQUAL", "BAND"]
    colour: Literal["MONO", "BAYER"]
    bayer_pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"]
    demosaicing: Literal["BILINEAR", "MALVAR", "EDGE_AWARE"]
    white_balance: Literal["SUN", "NONE"]
    grey: Literal["LUMINANCE", "MEAN"]
    red_centre_nm: float  # nm
    red_half_width_nm: float  # nm
    red_efficiency: float
    green_centre_nm: float  # nm
    green_half_width_nm: float  # nm
    green_efficiency: float
    blue_centre_nm: float  # nm
    blue_half_width_nm: float  # nm
    blue_efficiency: float
    filter_leak: float
    cut_on_nm: float  # nm
    cut_off_nm: float  # nm
    full_well_e: float  # e-
    gain: float
    read_noise_e: float  # e-
    shot_noise: bool
    dark_current_e_s: float  # e-/s
    temperature_k: float  # K
    dark_reference_k: float  # K
    dark_doubling_k: float  # K
    prnu: float
    dsnu_e: float  # e-
    blooming: float
    black_level: float
    bits: int  # bits
    psf_sigma_px: float  # px
    veiling_glare: float
    deposit_share: float
    deposit_mm: float  # mm
    deposit_window_mm: float  # mm
    deposit_scatter: float
    deposit_seed: int
    deposits_alike: bool
    radiation_flux_cm2_s: float  # 1/(cm² s)
    radiation_depth_um: float  # µm
    radiation_e_per_um: float  # e-/µm
    noise_seed: int


class QualityOverrides(TypedDict, total=False):
    """Changes of ``quality``."""

    samples: int  # samples
    denoiser: Literal["NONE", "OIDN", "OIDN_COLOUR"]
    noise_threshold: float
    diffuse_bounces: int  # bounces
    walk_px: float  # px
    fine_relief: Literal["ALL", "CAMERA"]
    indirect: Literal["TRACED", "BAKED", "AUTO"]
    direct_samples: int  # samples
    bake_area: Literal["GROUND", "VIEW"]
    bake_samples: int  # samples
    bake_noise: float
    files: Literal["COMPACT", "FULL"]
    half_floats: Literal["NONE", "RADIANCE", "RADIANCE_NORMALS"]
    truth: Literal["FULL", "SEMANTIC", "DEPTH"]
    truth_by: Literal["RAYS", "CYCLES"]
    device: Literal["CPU", "GPU"]
    threads: int  # threads


class DatasetOverrides(TypedDict, total=False):
    """Changes of ``dataset``."""

    folder: str
    seed: int
    headings: int  # pairs
    plan: str
    workers: int  # processes
    evaluate: bool
    leave_running: bool
    methods: str


class Overrides(TypedDict, total=False):
    """Changes of some settings of a scene, by topic."""

    source: SourceOverrides
    terrain: TerrainOverrides
    mesh: MeshOverrides
    ridges: RidgesOverrides
    cracks: CracksOverrides
    chaos: ChaosOverrides
    craters: CratersOverrides
    hollows: HollowsOverrides
    penitentes: PenitentesOverrides
    pits: PitsOverrides
    hills: HillsOverrides
    mantle: MantleOverrides
    excavation: ExcavationOverrides
    surface: SurfaceOverrides
    hapke: HapkeOverrides
    textures: TexturesOverrides
    rocks: RocksOverrides
    rock_surface: RockSurfaceOverrides
    light: LightOverrides
    rig: RigOverrides
    lander: LanderOverrides
    arm: ArmOverrides
    workspace: WorkspaceOverrides
    sensor: SensorOverrides
    quality: QualityOverrides
    dataset: DatasetOverrides
