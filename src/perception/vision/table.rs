use nalgebra::{Matrix3, Rotation2, Vector3};

use super::{Table, TableError};
use upm_core::geometry::{Homography, Lens, Vec2};

/// Corners of the square from -1 to 1 in the order of [`Table::corners_px`], y up.
const UNIT_CORNERS: [(f64, f64); 4] = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)];

/// Tolerances of a square: half the relative difference of the sides, and the cosine of their angle. They reject the
/// edge of a hand over a side of the plate, which was mistaken for that side, 6 % too near or 1.4° oblique.
const UNEQUAL_SIDES: f64 = 0.004;
const SKEW: f64 = 0.008;

/// Shortest and longest focal length of a camera about which nothing is known, in longer sides of the picture.
const FOCAL_RANGE: [f64; 2] = [0.4, 8.0];

impl Table {
    /// Square table from its corners in ideal image coordinates, px, clockwise from any of them. The table frame is
    /// turned so that its x axis is within 45° of the image's.
    ///
    /// # Errors
    /// [`TableError::NotASquare`] and [`TableError::Skewed`] when the four corners cannot be the image of a square in
    /// front of the camera.
    pub fn from_ideal_corners(corners: [Vec2; 4], side_m: f64, lens: &Lens) -> Result<Self, TableError> {
        Self::of_rectangle(corners, [side_m; 2], lens, [UNEQUAL_SIDES, SKEW])
    }

    /// As [`Self::from_ideal_corners`], for a rectangle of these sides, along x and along y. `most_off`: tolerances of
    /// half the relative difference of the sides, and of the cosine of their angle.
    ///
    /// # Errors
    /// As [`Self::from_ideal_corners`].
    pub fn of_rectangle(
        corners: [Vec2; 4],
        [side_m, height_m]: [f64; 2],
        lens: &Lens,
        most_off: [f64; 2],
    ) -> Result<Self, TableError> {
        let corners = upright(corners);
        let unit = UNIT_CORNERS.map(|(x, y)| Vec2::new(x, y));
        let ideal_from_unit = Homography::from_corners(unit, corners).ok_or(TableError::NotASquare)?;
        let unit_from_table = Matrix3::from_diagonal(&Vector3::new(2.0 / side_m, 2.0 / height_m, 1.0));
        let ideal_from_table = Homography::new(ideal_from_unit.matrix() * unit_from_table);
        let table_from_ideal = ideal_from_table.inverse().ok_or(TableError::NotASquare)?;
        let camera_in_table_m = camera_in_table(&ideal_from_table, lens, most_off)?;
        let corners_px = corners.map(|corner| lens.image_from_ideal(corner));
        let side_px = (0..4).map(|i| (corners_px[(i + 1) % 4] - corners_px[i]).norm()).sum::<f64>() / 4.0;
        let right = ideal_from_table.jacobian_at(Vec2::zeros()) * Vec2::x();
        let rotation_rad = libm::atan2(-right.y, right.x);
        let finite = side_px.is_finite() && rotation_rad.is_finite() && camera_in_table_m.iter().all(|x| x.is_finite());
        let table = Self {
            corners_px,
            side_px,
            rotation_rad,
            side_m,
            aspect: height_m / side_m,
            lens: *lens,
            table_from_ideal,
            ideal_from_table,
            camera_in_table_m,
        };
        if finite { Ok(table) } else { Err(TableError::NotASquare) }
    }

    /// The plane that a whole picture shows, in a table of `side_m` about its middle that the picture's corners are on.
    /// `tilt` is the gradient of the inverse depth, relative to that at the middle, 1/px.
    ///
    /// # Errors
    /// [`TableError::NotASquare`] where the plane ends within the picture.
    pub fn of_picture(size_px: [usize; 2], lens: &Lens, tilt: Vec2, side_m: f64) -> Result<Self, TableError> {
        // the plane through the point at depth 1 on the lens's axis
        let normal = (tilt * lens.focal_px).push(1.0).normalize();
        let right = (Vector3::x() - normal * normal.x).normalize();
        let (down, middle) = (normal.cross(&right), Vector3::z());
        let half = Vec2::from(size_px.map(|size| size as f64 / 2.0)) / lens.focal_px;
        let signs = UNIT_CORNERS.map(|(x, y)| Vec2::new(x, -y));
        let on_plane = |sign: Vec2| {
            let ray = sign.component_mul(&half).push(1.0);
            let at = ray * (normal.z / normal.dot(&ray)) - middle;
            Vec2::new(at.dot(&right).abs(), at.dot(&down).abs())
        };
        let reach = signs.map(on_plane).iter().fold(Vec2::zeros(), |most, at| most.sup(at));
        let corners = signs.map(|sign| {
            let at = middle + right * (sign.x * reach.x) + down * (sign.y * reach.y);
            lens.principal_px + at.xy() * (lens.focal_px / at.z)
        });
        Self::of_rectangle(corners, [side_m, side_m * reach.y / reach.x], lens, [UNEQUAL_SIDES, SKEW])
    }

    /// Middle of the table in the picture and the distance of its farthest corner, px.
    pub(super) fn extent(&self) -> (Vec2, f64) {
        let middle_px = self.corners_px.iter().sum::<Vec2>() / 4.0;
        (middle_px, self.corners_px.iter().fold(1e-9, |most: f64, corner| most.max((corner - middle_px).norm())))
    }

    /// A shift along the table's axes and a turn at its corners, px, in the picture's axes, y down.
    pub(super) fn in_picture(&self, swing_px: Vector3<f64>) -> Vector3<f64> {
        let shift_px = Rotation2::new(self.rotation_rad) * swing_px.xy();
        Vector3::new(shift_px.x, -shift_px.y, -swing_px.z)
    }

    /// The inverse of [`Self::in_picture`].
    pub(super) fn swing_of_picture(&self, motion_px: Vector3<f64>) -> Vector3<f64> {
        let shift_px = Rotation2::new(-self.rotation_rad) * Vec2::new(motion_px.x, -motion_px.y);
        shift_px.push(-motion_px.z)
    }

    /// A gradient on the plate at its middle, 1/m, in the picture, 1/px.
    pub fn picture_gradient(&self, per_m: Vec2) -> Vec2 {
        self.table_from_ideal.jacobian_at(self.ideal_from_table.apply(Vec2::zeros())).transpose() * per_m
    }

    /// Angle between the lens's axis and the plate's normal.
    pub fn tilt_rad(&self) -> f64 {
        let axis = self.table_from_ideal.apply(self.lens.principal_px).push(0.0) - self.camera_in_table_m;
        libm::atan2(axis.xy().norm(), -axis.z)
    }

    /// Point of the plate's plane, m, at an image point, px.
    pub fn table_from_image(&self, image_px: Vec2) -> Vec2 {
        self.table_from_ideal.apply(self.lens.ideal_from_image(image_px))
    }

    /// Image point, px, of a point of the plate's plane, m.
    pub fn image_from_table(&self, p_m: Vec2) -> Vec2 {
        self.lens.image_from_ideal(self.ideal_from_table.apply(p_m))
    }

    /// Scale on the plate at `p_m`, px/m: the square root of the magnification of areas.
    pub fn px_per_m_at(&self, p_m: Vec2) -> f64 {
        let ideal = self.ideal_from_table.apply(p_m);
        let map = self.lens.jacobian_at_ideal(ideal) * self.ideal_from_table.jacobian_at(p_m);
        map.determinant().abs().sqrt()
    }

    /// Mean of [`Table::px_per_m_at`] over the plate.
    pub fn mean_px_per_m(&self) -> f64 {
        let places = [-1.0, 0.0, 1.0].map(|x| x * self.side_m / 3.0);
        let scales = places.iter().flat_map(|&x| places.map(|y| self.px_per_m_at(Vec2::new(x, y))));
        scales.sum::<f64>() / 9.0
    }

    /// Parallax of a point `height_m` above `p_m`: displacement of its projection onto the plate, m, and relative
    /// magnification. By similar triangles from the camera's centre: `(p - c) h / (H - h)` and `h / (H - h)`. Zero for
    /// a camera lower than twice the height.
    pub fn parallax(&self, p_m: Vec2, height_m: f64) -> (Vec2, f64) {
        let growth = height_m / (self.camera_in_table_m.z - height_m);
        if !(0.0..1.0).contains(&growth) {
            return (Vec2::zeros(), 0.0);
        }
        ((p_m - self.camera_in_table_m.xy()) * growth, growth)
    }

    /// Centre of a part that is `thickness_m` high and whose outline is centred at `center_px`, m.
    pub fn part_in_table(&self, center_px: Vec2, thickness_m: f64) -> Vec2 {
        let seen_m = self.table_from_image(center_px);
        let (shift_m, growth) = self.parallax(seen_m, thickness_m);
        seen_m - shift_m / (1.0 + growth)
    }

    /// True when `p_m` is on the plate, `margin_m` or more inside its edge.
    pub fn holds(&self, p_m: Vec2, margin_m: f64) -> bool {
        let half_m = self.side_m / 2.0;
        p_m.x.abs() <= half_m - margin_m && p_m.y.abs() <= half_m * self.aspect - margin_m
    }
}

/// Corners rotated to begin with the one from which the top side runs to the right.
fn upright(corners: [Vec2; 4]) -> [Vec2; 4] {
    let turned = [0, 1, 2, 3].map(|k| [0, 1, 2, 3].map(|i| corners[(i + k) % 4]));
    let rightward = |c: &[Vec2; 4]| (c[1] - c[0] + c[2] - c[3]).normalize().x;
    turned.iter().fold(corners, |best, &next| if rightward(&next) > rightward(&best) { next } else { best })
}

/// The camera's centre from the columns `K⁻¹ H = λ [r1 r2 t]` of a plane's homography (Zhang, 2000). An error when the
/// plate is no rectangle for a camera of that focal length, to within `most_off`.
fn camera_in_table(ideal_from_table: &Homography, lens: &Lens, most_off: [f64; 2]) -> Result<Vector3<f64>, TableError> {
    let (f, c) = (lens.focal_px, lens.principal_px);
    let k_inverse = Matrix3::new(1.0 / f, 0.0, -c.x / f, 0.0, 1.0 / f, -c.y / f, 0.0, 0.0, 1.0);
    let columns = k_inverse * ideal_from_table.matrix();
    let (r1, r2, t) = (columns.column(0), columns.column(1), columns.column(2));
    let scale = (r1.norm() + r2.norm()) / 2.0 * t.z.signum();
    let (r1, r2, t) = (r1 / scale, r2 / scale, t / scale);
    if !((r1.norm() - 1.0).abs() < most_off[0] && r1.dot(&r2).abs() < most_off[1]) {
        let (ratio, angle_deg) = (r1.norm() / r2.norm(), r1.angle(&r2).to_degrees());
        return Err(TableError::Skewed { ratio, angle_deg });
    }
    let rotation = Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]);
    let svd = rotation.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return Err(TableError::NotASquare) };
    let camera = -(u * v_t).transpose() * t;
    if camera.z > 0.0 { Ok(camera) } else { Err(TableError::NotASquare) }
}

/// Focal length, px, of the camera that sees a rectangle, `aspect` times as high as wide, with its corners there, and
/// the share of it that the picture determines, 0 to 1. Zhang's two conditions, `r1·r2 = 0` and `|r1| = |r2|`, are
/// linear in one over its square; without a tilt they say nothing, and for corners known to `sd_px` the solution is
/// pulled to `expected_px` as far as they leave it open.
pub fn focal_from_corners(
    corners: [Vec2; 4],
    aspect: f64,
    [expected_px, sd_px]: [f64; 2],
    lens: &Lens,
) -> Option<(f64, f64)> {
    /// Relative error of a column of the homography from one of a corner.
    const COLUMN: f64 = 1.4;
    let unit = UNIT_CORNERS.map(|(x, y)| Vec2::new(x, y * aspect));
    let h = *Homography::from_corners(unit, upright(corners).map(|corner| corner - lens.principal_px))?.matrix();
    let square = (h.fixed_view::<2, 2>(0, 0).norm_squared() / 2.0).max(f64::MIN_POSITIVE);
    let [a, b, c, d] = [
        (h.m11 * h.m12 + h.m21 * h.m22) / square,
        (h.m11 * h.m11 + h.m21 * h.m21 - h.m12 * h.m12 - h.m22 * h.m22) / (2.0 * square),
        h.m31 * h.m32,
        (h.m31 * h.m31 - h.m32 * h.m32) / 2.0,
    ];
    let loose = (COLUMN * sd_px).powi(2) / square;
    let per_focal = |focal_px: f64| square / focal_px.powi(2);
    let solution = (loose * per_focal(expected_px) - a * c - b * d) / (loose + a * a + b * b);
    let [least, most] = FOCAL_RANGE.map(|share| per_focal(share * 2.0 * lens.principal_px.amax()));
    let focal_px = (square / solution.clamp(most, least)).sqrt();
    focal_px.is_finite().then_some((focal_px, (a * a + b * b) / (loose + a * a + b * b)))
}
