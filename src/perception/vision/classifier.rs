use nalgebra::Matrix2;

use super::disk::DiskKernel;
use super::rim::{RimFinder, RimFit};
use super::sampling::Sampler;
use super::{Detection, Table};
use upm_core::geometry::Vec2;
use upm_core::rig::PartKind;
use upm_core::signal::Frame;

/// Lowest score of a part.
pub(super) const LEAST_SCORE: f64 = 0.75;
/// Largest deviation of a measured radius from its kind's, as a fraction of it.
const RADIUS_TOLERANCE: f64 = 0.08;
/// Two detections nearer than this share of their radii's sum are the same part.
pub(super) const APART: f64 = 0.8;

/// Classifies a rim on a table as a kind of part, or as none. Shared by the full search and the tracker.
pub(super) struct PartClassifier {
    pub(super) table: Table,
    pub(super) kinds: Vec<PartKind>,
    pub(super) dark_parts: bool,
    /// Disk of each kind, px.
    pub(super) disks: Vec<DiskKernel>,
    rim: RimFinder,
}

impl PartClassifier {
    pub(super) fn new(table: &Table, kinds: &[PartKind], dark_parts: bool) -> Self {
        let disks = kernel_radii_px(table, kinds).into_iter().map(DiskKernel::new).collect();
        Self { table: table.clone(), kinds: kinds.to_vec(), dark_parts, disks, rim: RimFinder::new(dark_parts) }
    }

    /// Radius of the outline of a part of `kind`, px; 0 for an unknown kind.
    pub(super) fn radius_px(&self, kind: usize) -> f64 {
        self.disks.get(kind).map_or(0.0, |disk| disk.reach() as f64)
    }

    /// Rim of a part of `kind` near `foot_m`, from `N` samples along each ray; see [`RimFinder::fit`].
    pub(super) fn rim<const N: usize>(&self, at: &Sampler, kind: usize, foot_m: Vec2, reach_px: f64) -> Option<RimFit> {
        self.rim.fit::<N>(at, &self.table, self.kinds.get(kind)?, foot_m, reach_px)
    }

    /// The same over a short reach.
    pub(super) fn close_rim(&self, sampler: &Sampler, kind: usize, foot_m: Vec2) -> Option<RimFit> {
        self.rim::<9>(sampler, kind, foot_m, reach_px(self.radius_px(kind)))
    }

    /// The same over a long reach.
    pub(super) fn wide_rim(&self, sampler: &Sampler, kind: usize, foot_m: Vec2) -> Option<RimFit> {
        self.rim::<25>(sampler, kind, foot_m, (0.2 * self.radius_px(kind)).max(5.0))
    }

    /// Foot of a part of `kind` whose outline is centred at `center_px`.
    pub(super) fn foot_below(&self, kind: usize, center_px: Vec2) -> Vec2 {
        let seen = self.table.table_from_image(center_px);
        let thickness_m = self.kinds.get(kind).map_or(0.0, |k| k.thickness_m);
        seen - self.table.parallax(seen, thickness_m).0 / 2.0
    }

    /// The kind with the nearest radius, `None` where none is within tolerance.
    pub(super) fn nearest_kind(&self, radius_m: f64) -> Option<usize> {
        let off = |kind: &PartKind| (radius_m / kind.radius_m - 1.0).abs();
        let best = (0..self.kinds.len()).min_by(|&a, &b| off(&self.kinds[a]).total_cmp(&off(&self.kinds[b])))?;
        (off(&self.kinds[best]) < RADIUS_TOLERANCE).then_some(best)
    }

    /// The parts of a frame that has positions in place of pixels; `None` for a picture.
    pub(super) fn measured(&self, frame: &Frame) -> Option<Vec<Detection>> {
        let (positions, table) = (frame.positions.as_ref()?, &self.table);
        let found = positions.discs.iter().filter_map(|disc| {
            let kind = self.nearest_kind(disc.radius_m)?;
            let seen_m = table.table_from_image(disc.center_px);
            let thickness_m = self.kinds.get(kind)?.thickness_m;
            Some(Detection {
                kind,
                center_px: disc.center_px,
                radius_px: disc.radius_m * (1.0 + table.parallax(seen_m, thickness_m).1) * table.px_per_m_at(seen_m),
                position_m: table.part_in_table(disc.center_px, thickness_m),
                score: 1.0,
                covariance_px2: Matrix2::from_diagonal_element(disc.sd_px.powi(2)),
            })
        });
        Some(found.collect())
    }

    /// Detection of a part of `kind` from its rim. `None` where the kind's disk does not fit the frame.
    pub(super) fn detection(&self, frame: &Frame, fit: &RimFit, kind: usize) -> Option<Detection> {
        let disk = self.disks.get(kind)?;
        let [x, y] = [fit.center_px.x, fit.center_px.y].map(|v| v.round() as i64);
        let (x, y) = disk.fitted(frame, x, y)?;
        let contrast = f64::from(fit.plate_level - fit.part_level);
        let score = ((f64::from(fit.plate_level) - disk.mean(frame, x, y)) / contrast).clamp(0.0, 1.0);
        Some(Detection {
            kind,
            center_px: fit.center_px,
            radius_px: fit.radius_px,
            position_m: fit.foot_m,
            score,
            covariance_px2: fit.covariance_px2,
        })
    }
}

/// Half the length of the close search across a rim of that radius, px.
pub(super) fn reach_px(radius_px: f64) -> f64 {
    4.0f64.min(0.4 * radius_px)
}

/// Radius of the disk that a part of each kind shows at the plate's mean scale, px; no larger than the plate.
pub(super) fn kernel_radii_px(table: &Table, kinds: &[PartKind]) -> Vec<f64> {
    let scale = table.mean_px_per_m();
    let shown = |kind: &PartKind| kind.radius_m * scale * (1.0 + table.parallax(Vec2::zeros(), kind.thickness_m).1);
    kinds.iter().map(|kind| shown(kind).clamp(0.0, table.side_px.max(0.0))).collect()
}

/// True when two detections are too close to be two parts.
pub(super) fn overlap(a: &Detection, b: &Detection) -> bool {
    (a.center_px - b.center_px).norm() < APART * (a.radius_px + b.radius_px)
}
