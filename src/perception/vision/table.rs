use nalgebra::{Matrix3, Vector3};

use super::Table;
use upm_core::geometry::{Homography, Lens, Vec2};

/// Corners of the square from -1 to 1 in the order of [`Table::corners_px`], y up.
const UNIT_CORNERS: [(f64, f64); 4] = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)];

/// Tolerances of a square: half the relative difference of the sides, and the cosine of their angle. They reject the
/// edge of a hand over a side of the plate, which was mistaken for that side, 6 % too near or 1.4° oblique.
const UNEQUAL_SIDES: f64 = 0.004;
const SKEW: f64 = 0.008;

impl Table {
    /// Table from its corners in ideal image coordinates, px, clockwise from any of them. The table frame is turned so
    /// that its x axis is within 45° of the image's. `None` when the four corners cannot be the image of a plane in
    /// front of the camera.
    pub fn from_ideal_corners(corners: [Vec2; 4], side_m: f64, lens: &Lens) -> Option<Self> {
        let corners = upright(corners);
        let unit = UNIT_CORNERS.map(|(x, y)| Vec2::new(x, y));
        let ideal_from_unit = Homography::from_corners(unit, corners)?;
        let unit_from_table = Matrix3::from_diagonal(&Vector3::new(2.0 / side_m, 2.0 / side_m, 1.0));
        let ideal_from_table = Homography::new(ideal_from_unit.matrix() * unit_from_table);
        let table_from_ideal = ideal_from_table.inverse()?;
        let camera_in_table_m = camera_in_table(&ideal_from_table, lens)?;
        let corners_px = corners.map(|corner| lens.image_from_ideal(corner));
        let side_px = (0..4).map(|i| (corners_px[(i + 1) % 4] - corners_px[i]).norm()).sum::<f64>() / 4.0;
        let right = ideal_from_table.jacobian_at(Vec2::zeros()) * Vec2::x();
        let rotation_rad = (-right.y).atan2(right.x);
        let finite = side_px.is_finite() && rotation_rad.is_finite() && camera_in_table_m.iter().all(|x| x.is_finite());
        finite.then_some(Self {
            corners_px,
            side_px,
            rotation_rad,
            side_m,
            lens: *lens,
            table_from_ideal,
            ideal_from_table,
            camera_in_table_m,
        })
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

    /// True when `p_m` is on the plate, `margin_m` or more inside its edge.
    pub fn holds(&self, p_m: Vec2, margin_m: f64) -> bool {
        p_m.amax() <= self.side_m / 2.0 - margin_m
    }
}

/// Corners rotated to begin with the one from which the top side runs to the right.
fn upright(corners: [Vec2; 4]) -> [Vec2; 4] {
    let turned = [0, 1, 2, 3].map(|k| [0, 1, 2, 3].map(|i| corners[(i + k) % 4]));
    let rightward = |c: &[Vec2; 4]| (c[1] - c[0] + c[2] - c[3]).normalize().x;
    turned.iter().fold(corners, |best, &next| if rightward(&next) > rightward(&best) { next } else { best })
}

/// The camera's centre from the columns `K⁻¹ H = λ [r1 r2 t]` of a plane's homography (Zhang, 2000). `None` when the
/// plate is not square for a camera of that focal length, to within `UNEQUAL_SIDES` and `SKEW`.
fn camera_in_table(ideal_from_table: &Homography, lens: &Lens) -> Option<Vector3<f64>> {
    let (f, c) = (lens.focal_px, lens.principal_px);
    let k_inverse = Matrix3::new(1.0 / f, 0.0, -c.x / f, 0.0, 1.0 / f, -c.y / f, 0.0, 0.0, 1.0);
    let columns = k_inverse * ideal_from_table.matrix();
    let (r1, r2, t) = (columns.column(0), columns.column(1), columns.column(2));
    let scale = (r1.norm() + r2.norm()) / 2.0 * t.z.signum();
    let (r1, r2, t) = (r1 / scale, r2 / scale, t / scale);
    if !((r1.norm() - 1.0).abs() < UNEQUAL_SIDES && r1.dot(&r2).abs() < SKEW) {
        return None;
    }
    let rotation = Matrix3::from_columns(&[r1, r2, r1.cross(&r2)]);
    let svd = rotation.svd(true, true);
    let camera_from_table = svd.u? * svd.v_t?;
    let camera = -camera_from_table.transpose() * t;
    (camera.z > 0.0).then_some(camera)
}
