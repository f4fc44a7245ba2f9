use nalgebra::Vector3;

use super::ClutterOutline;
use upm_core::geometry::{Lens, Vec2};
use upm_core::units::INCH_M;

/// A plate with parts, the camera above it, light, blur and noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Columns and rows, px.
    pub size_px: [usize; 2],
    /// The camera's intrinsic geometry.
    pub lens: Lens,
    /// Camera centre in the table frame, m.
    pub camera_m: Vector3<f64>,
    /// Rotation from looking straight down: turns of the plate in the picture, about the camera's x and y axes and then
    /// about the optical axis, right-handed (x right, y down, axis away from the camera), rad.
    pub tilt_rad: [f64; 3],
    /// Side of the plate, m.
    pub side_m: f64,
    /// Gray levels of ground, plate and parts in full light.
    pub levels: [f64; 3],
    /// Relative loss of light from the near corner of the picture to the far one.
    pub shading: f64,
    /// Direction in which light falls off, rad, from the picture's x to its y axis, the picture taken as a square.
    pub shading_direction_rad: f64,
    /// Standard deviation of the lens's blur, px.
    pub blur_px: f64,
    /// Standard deviation of the noise, levels.
    pub noise_sd: f64,
    /// Seed of the noise.
    pub seed: u64,
    /// Parts, later ones in front.
    pub parts: Vec<SceneDisc>,
    /// Reflections of lamps in the plate, in m of the table frame.
    pub glints: Vec<Glint>,
    /// Objects on the ground, behind the plate.
    pub clutter: Vec<ClutterShape>,
    /// Objects in front of everything.
    pub occluders: Vec<ClutterShape>,
}

/// A part: a disc on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneDisc {
    /// Index into [`kinds`](super::kinds).
    pub kind: usize,
    /// Middle of its foot in the table frame, m.
    pub at_m: Vec2,
    /// Radius of foot and top, m.
    pub radius_m: f64,
    /// Height, m.
    pub thickness_m: f64,
    /// Texture stamped on it.
    pub relief: Option<SurfaceTexture>,
    /// Reflections of lamps in it, in radii from its middle.
    pub glints: Vec<Glint>,
}

impl SceneDisc {
    /// A smooth disc of kind 0 with its foot's middle at `at_m`.
    pub fn new(at_m: Vec2, radius_m: f64, thickness_m: f64) -> Self {
        Self { kind: 0, at_m, radius_m, thickness_m, relief: None, glints: Vec::new() }
    }
}

/// Gray level over a part's face: three waves and a ring, `a (mean of cos(k·q + phase) + ring) / 2` of the step from
/// part to plate, `q` in radii from the part's middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceTexture {
    /// Largest deviation, as a fraction of the step from part to plate.
    pub amplitude: f64,
    /// Wave vectors, rad a radius, and phases, rad.
    pub waves: [(Vec2, f64); 3],
    /// Radius and width of the ring, radii.
    pub ring: [f64; 2],
}

/// A bright ellipse with soft edges. Lengths are in metres on the plate, in radii on a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glint {
    /// Middle.
    pub at: Vec2,
    /// Half axes; half as bright at about 3/4 of them.
    pub half_axes: [f64; 2],
    /// Direction of the first half axis, rad.
    pub direction_rad: f64,
    /// Gray level in its middle; beyond 255 it saturates.
    pub level: f64,
}

/// An object of one gray level, its outline on the plate's plane.
#[derive(Clone, Debug, PartialEq)]
pub struct ClutterShape {
    /// Region of the plate's plane that it covers, table frame, m.
    pub shape: ClutterOutline,
    /// Gray level in full light.
    pub level: f64,
}

/// True position of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScenePartTruth {
    /// Index into [`kinds`](super::kinds).
    pub kind: usize,
    /// Middle of its foot in the table frame, m.
    pub at_m: Vec2,
    /// Centroid of its outline in the picture, px: the area that foot and top cover together, through the lens.
    pub center_px: Vec2,
    /// Radius of the circle of that area, px.
    pub radius_px: f64,
}

impl Scene {
    /// An empty 8 in plate, white on dark ground, 1280 × 1024 px, 4.2 px/mm, looking straight down, sharp and clean.
    pub fn plain(seed: u64) -> Self {
        Self {
            size_px: [1280, 1024],
            lens: Lens::ideal(2520.0, Vec2::new(639.5, 511.5)),
            camera_m: Vector3::new(0.0, 0.0, 0.6),
            tilt_rad: [0.0; 3],
            side_m: 8.0 * INCH_M,
            levels: [18.0, 215.0, 30.0],
            shading: 0.0,
            shading_direction_rad: 0.3f64.atan2(0.7),
            blur_px: 0.8,
            noise_sd: 0.0,
            seed,
            parts: Vec::new(),
            glints: Vec::new(),
            clutter: Vec::new(),
            occluders: Vec::new(),
        }
    }

    /// True when parts are darker than the plate.
    pub fn dark_parts(&self) -> bool {
        let [_, plate, part] = self.levels;
        part < plate
    }
}
