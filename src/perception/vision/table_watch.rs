use nalgebra::{Matrix4, Rotation2, Vector3, Vector4};

use super::Table;
use super::sampling::{Sampler, biweight, quantile, rising_crossing};
use upm_core::geometry::{Vec2, cross, perp};
use upm_core::signal::Frame;

/// Profiles across each side.
const PROFILES: usize = 16;
const ALL: usize = 4 * PROFILES;
/// Levels along a profile, a pixel apart; its middle one is on the side.
const SAMPLES: usize = 13;
const MIDDLE: f64 = (SAMPLES as f64 - 1.0) / 2.0;
/// Share of a side at each end without profiles.
const ENDS: f64 = 0.05;
/// Least step across a side, levels and as a fraction of the strong ones in the same frame.
const FAINTEST: f32 = 4.0;
const WEAKEST: f64 = 0.4;
/// Least ratio of the sum of the steps across the sides to the sum of their magnitudes: near 1 where most steps go from
/// ground to plate; in noise they cancel.
const ONE_WAY: f32 = 0.5;
/// Profiles of a side that must agree with the motion of the other sides before it counts as seen.
const AGREEING: usize = 4;
/// Sides needed to determine a motion of the plate.
const SIDES: usize = 3;
/// A larger median of the least-squares residuals, px, means that a side disagrees as a whole.
const DISAGREEMENT_PX: f64 = 0.25;
/// Crossings with more scatter than this about a motion of the plate, px, are not a side.
const MOST_SCATTER_PX: f64 = 0.5;
const LEAST_SCATTER_PX: f64 = 0.05;
const ROUNDS: usize = 5;
/// From this level on a pixel may be saturated.
const SATURATED: f32 = 250.0;
/// Largest distance, px, of the sides from where the table was located in the same frame.
const MOST_LOCATION_ERROR_PX: f64 = 0.3;
/// Largest level difference within a profile that is wholly on the plate or wholly on the ground, as a fraction of the
/// step between the two.
const FLAT: f32 = 0.35;
/// Samples left out at either end of such a profile: there a side at the window's end has an influence.
const FLAT_ENDS: usize = 2;
/// Least step between plate and ground, levels, and least number of flat profiles on either, for a displaced plate.
const FLAT_STEP: f32 = 10.0;
const FLAT_PROFILES: usize = 10;

/// Displacement of the plate's sides since the table was located.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TableMotion {
    /// At least three sides are seen near their expected positions.
    Seen {
        /// Shift along the table's axes and turn at the corners that fit the seen sides best, px.
        swing_px: Vector3<f64>,
        /// Largest displacement of a corner, px, under that shift and turn and the growth fitted with them.
        corner_px: f64,
    },
    /// Plate and ground are seen, and both where a side was: the plate has moved by more than the 6 px that profiles
    /// reach.
    Displaced,
    /// Too little shows to judge: a dark or unreadable frame, or two or more sides covered.
    Hidden,
}

impl TableMotion {
    /// Shift and turn, px, of a plate that is seen near its place.
    pub fn swing_px(&self) -> Option<Vector3<f64>> {
        if let Self::Seen { swing_px, .. } = self { Some(*swing_px) } else { None }
    }

    /// Largest displacement of a corner, px: infinite for a displaced plate, `None` when the frame does not determine
    /// it.
    pub fn corner_px(&self) -> Option<f64> {
        match self {
            Self::Seen { corner_px, .. } => Some(*corner_px),
            Self::Displaced => Some(f64::INFINITY),
            Self::Hidden => None,
        }
    }
}

/// Follows the sides of a table located before, by gray level profiles across them.
///
/// The half-level crossings of all profiles are fitted with one motion of the plate's image: a shift, a turn and
/// growth; biweights reject profiles of other objects (coins over the edge, a hand). Crossings do not depend on light,
/// except where the plate saturates: there every side moves outwards by up to 0.4 px, so that in saturated frames
/// growth is not counted as displacement.
pub struct TableWatch {
    table: Table,
    profiles: [Profile; ALL],
    /// Corners from the plate's middle, in units of the farthest one's distance.
    corners: [Vec2; 4],
    frame_size: [usize; 2],
    /// The motion measured in the frame in which the table was located: the error of its location.
    rest: Vector4<f64>,
}

/// One profile across a side.
#[derive(Clone, Copy)]
struct Profile {
    center_px: Vec2,
    /// Outward unit normal of the side.
    outward: Vec2,
    /// Offset of the side at the profile under unit shifts along x and y, a turn and growth.
    row: Vector4<f64>,
}

/// Profile measurements of one frame.
struct SideReading {
    levels: [[f32; SAMPLES]; ALL],
    /// Offset of the side along its outward normal, px; NaN where no crossing is seen.
    crossings: [f64; ALL],
    saturated: bool,
}

impl TableWatch {
    /// For frames of `frame_size` (columns, rows).
    pub fn new(table: &Table, frame_size: [usize; 2]) -> Self {
        let (middle_px, radius_px) = table.extent();
        Self {
            profiles: profiles(table, Vector3::zeros()),
            corners: table.corners_px.map(|corner_px| (corner_px - middle_px) / radius_px),
            table: table.clone(),
            frame_size,
            rest: Vector4::zeros(),
        }
    }

    /// Takes the sides in `frame`, in which the table was located, as the zero of later motions. No effect where they
    /// are farther from it than the error of a location.
    pub fn set_rest(&mut self, frame: &Frame) {
        self.rest = Vector4::zeros();
        let fitted = self.read(frame, &self.profiles).and_then(|reading| self.fit(&reading, &self.profiles));
        self.rest = fitted.filter(|motion| self.corner_px(motion) < MOST_LOCATION_ERROR_PX).unwrap_or(self.rest);
    }

    /// Measures the sides in `frame`. A frame of another size is [`TableMotion::Hidden`].
    pub fn check(&self, frame: &Frame) -> TableMotion {
        if let Some(positions) = &frame.positions {
            return positions.corners_px.map_or(TableMotion::Hidden, |corners_px| self.motion_to(corners_px));
        }
        self.measured(frame, &self.profiles)
    }

    /// Swing of a plate that is within 6 px of one of `swings_px` in `frame`, as in [`TableMotion::Seen`]; `None`
    /// where it is at none of them.
    pub fn swing_near(&self, frame: &Frame, swings_px: &[Vector3<f64>]) -> Option<Vector3<f64>> {
        let near = |&near_px: &Vector3<f64>| match self.measured(frame, &profiles(&self.table, near_px)) {
            TableMotion::Seen { swing_px, .. } => Some(near_px + swing_px),
            _ => None,
        };
        swings_px.iter().find_map(near)
    }

    fn measured(&self, frame: &Frame, profiles: &[Profile; ALL]) -> TableMotion {
        let Some(reading) = self.read(frame, profiles) else { return TableMotion::Hidden };
        match self.fit(&reading, profiles) {
            Some(motion) => self.seen(motion),
            None if is_displaced(&reading.levels) => TableMotion::Displaced,
            None => TableMotion::Hidden,
        }
    }

    fn seen(&self, motion: Vector4<f64>) -> TableMotion {
        TableMotion::Seen { swing_px: self.table.swing_of_picture(motion.xyz()), corner_px: self.corner_px(&motion) }
    }

    /// Motion of the plate to where its corners are at `corners_px`.
    fn motion_to(&self, corners_px: [Vec2; 4]) -> TableMotion {
        let moved = |i: usize| {
            let ways = corners_px.map(|corner_px| corner_px - self.table.corners_px[i]);
            ways.into_iter().min_by(|a, b| a.norm().total_cmp(&b.norm())).unwrap_or_default()
        };
        let shift_px = (0..4).map(moved).sum::<Vec2>() / 4.0;
        let arms = || self.corners.iter().map(|corner| corner.norm_squared()).sum::<f64>();
        let [turn, growth] = [perp, |arm| arm]
            .map(|along: fn(Vec2) -> Vec2| (0..4).map(|i| along(self.corners[i]).dot(&moved(i))).sum::<f64>() / arms());
        self.seen(Vector4::new(shift_px.x, shift_px.y, turn, growth))
    }

    /// Reads the profiles, which run from outside to inside.
    fn read(&self, frame: &Frame, profiles: &[Profile; ALL]) -> Option<SideReading> {
        let sampler = Sampler::new(frame).filter(|_| [frame.width, frame.height] == self.frame_size)?;
        let levels = profiles.map(|Profile { center_px, outward, .. }| {
            let (from, to) = (center_px + outward * MIDDLE, center_px - outward * MIDDLE);
            sampler.profile::<SAMPLES>(from, to)
        });
        let outside = |levels: &[f32; SAMPLES]| (levels[0] + levels[1]) / 2.0;
        let inside = |levels: &[f32; SAMPLES]| (levels[SAMPLES - 1] + levels[SAMPLES - 2]) / 2.0;
        let steps = levels.each_ref().map(|levels| inside(levels) - outside(levels));
        let total: f32 = steps.iter().sum();
        let sign = total.signum();
        let steps = steps.map(|step| sign * step);
        let one_way = total.abs() > ONE_WAY * steps.iter().map(|step| step.abs()).sum::<f32>();
        let strong = if one_way { quantile(&mut steps.map(f64::from), 0.75) } else { f64::INFINITY };
        let least = ((WEAKEST * strong) as f32).max(FAINTEST);
        let crossings = std::array::from_fn(|i| {
            if steps[i] < least {
                return f64::NAN;
            }
            let profile = levels[i].map(|level| sign * level);
            let at = rising_crossing(&profile, sign * outside(&levels[i]), sign * inside(&levels[i]));
            at.map_or(f64::NAN, |at| MIDDLE - at - profiles[i].row.dot(&self.rest))
        });
        let saturated = levels.iter().any(|levels| inside(levels).max(outside(levels)) >= SATURATED);
        Some(SideReading { levels, crossings, saturated })
    }

    /// The motion that fits most profiles on at least three sides: shift along x and y, turn and growth at the farthest
    /// corner, px.
    fn fit(&self, reading: &SideReading, profiles: &[Profile; ALL]) -> Option<Vector4<f64>> {
        let crossings = &reading.crossings;
        let mut weights = crossings.map(|at| if at.is_finite() { 1.0 } else { 0.0 });
        let (mut motion, mut scatter_px) = start(profiles, crossings, &weights)?;
        for _ in 0..ROUNDS {
            for (i, weight) in weights.iter_mut().enumerate() {
                let off = crossings[i] - profiles[i].row.dot(&motion);
                *weight = if off.is_finite() { biweight(off / scatter_px) } else { 0.0 };
            }
            motion = fitted(profiles, crossings, &weights)?;
            scatter_px = scattered_px(profiles, crossings, &motion);
        }
        let is_seen = |side: &&[f64]| side.iter().filter(|&&weight| weight > 0.0).count() >= AGREEING;
        let seen = weights.chunks(PROFILES).filter(is_seen).count();
        if seen < SIDES || scatter_px > MOST_SCATTER_PX {
            return None;
        }
        if reading.saturated {
            motion.w = 0.0;
        }
        Some(motion)
    }

    /// Largest displacement of a corner by a motion, px.
    fn corner_px(&self, motion: &Vector4<f64>) -> f64 {
        let [x, y, turn, growth] = (*motion).into();
        let moved = |corner: Vec2| (Vec2::new(x, y) + perp(corner) * turn + corner * growth).norm();
        self.corners.iter().fold(0.0, |most: f64, &corner| most.max(moved(corner)))
    }
}

/// Profiles across the sides of a plate that has swung by `swing_px` from its place.
fn profiles(table: &Table, swing_px: Vector3<f64>) -> [Profile; ALL] {
    let (middle_px, radius_px) = table.extent();
    let half_m = table.side_m / 2.0;
    let m_per_px = half_m * std::f64::consts::SQRT_2 / radius_px;
    let turned = Rotation2::new(swing_px.z / radius_px);
    std::array::from_fn(|i| {
        let share = ENDS + (1.0 - 2.0 * ENDS) * ((i % PROFILES) as f64 + 0.5) / PROFILES as f64;
        let along = 2.0 * share - 1.0;
        // Clockwise in the image: along the top to the right, down the right side, and so on.
        let out = [Vec2::y(), Vec2::x(), -Vec2::y(), -Vec2::x()][i / PROFILES];
        let at = |along: f64| {
            let place_m = turned * ((out - perp(out) * along) * half_m) + swing_px.xy() * m_per_px;
            table.image_from_table(place_m)
        };
        let tangent = (at(along + 0.01) - at(along - 0.01)).normalize();
        let (center_px, outward) = (at(along), -perp(tangent));
        let arm = (center_px - middle_px) / radius_px;
        let row = Vector4::new(outward.x, outward.y, cross(arm, outward), arm.dot(&outward));
        Profile { center_px, outward, row }
    })
}

/// The initial motion, and the scatter about it: of all sides, or without the side that disagrees most.
fn start(profiles: &[Profile; ALL], crossings: &[f64; ALL], weights: &[f64; ALL]) -> Option<(Vector4<f64>, f64)> {
    let scattered = |motion: Vector4<f64>| (motion, scattered_px(profiles, crossings, &motion));
    let mut best = scattered(fitted(profiles, crossings, weights)?);
    let seen = |side: usize| weights[side * PROFILES..][..PROFILES].iter().sum::<f64>() >= AGREEING as f64;
    if best.1 < 1.4826 * DISAGREEMENT_PX || !(0..4).all(seen) {
        return Some(best);
    }
    for side in 0..4 {
        let mut others = *weights;
        others[side * PROFILES..][..PROFILES].fill(0.0);
        let without = fitted(profiles, crossings, &others).map(scattered);
        best = without.filter(|(_, scatter_px)| *scatter_px < best.1).unwrap_or(best);
    }
    Some(best)
}

/// Shift along x and y, turn and growth by weighted least squares, all in px, the last two at the farthest corner.
fn fitted(profiles: &[Profile; ALL], crossings: &[f64; ALL], weights: &[f64; ALL]) -> Option<Vector4<f64>> {
    let (mut normal, mut right) = (Matrix4::identity() * 1e-6, Vector4::zeros());
    for ((profile, &crossing), &weight) in profiles.iter().zip(crossings).zip(weights) {
        if weight > 0.0 {
            let weighted = profile.row * weight;
            normal += weighted * profile.row.transpose();
            right += weighted * crossing;
        }
    }
    normal.cholesky().map(|factors| factors.solve(&right))
}

/// Robust standard deviation of the crossings about a motion, px.
fn scattered_px(profiles: &[Profile; ALL], crossings: &[f64; ALL], motion: &Vector4<f64>) -> f64 {
    let (mut off, mut count) = ([0.0; ALL], 0);
    for (profile, crossing) in profiles.iter().zip(crossings).filter(|(_, crossing)| crossing.is_finite()) {
        off[count] = (crossing - profile.row.dot(motion)).abs();
        count += 1;
    }
    (1.4826 * quantile(&mut off[..count], 0.5)).max(LEAST_SCATTER_PX)
}

/// True when some profiles are wholly on something light and others wholly on something dark: the side between the two
/// has left its position.
fn is_displaced(levels: &[[f32; SAMPLES]; ALL]) -> bool {
    let range = |levels: &[f32]| levels.iter().fold((f32::MAX, f32::MIN), |(a, b), &v| (a.min(v), b.max(v)));
    let ranges = levels.each_ref().map(|levels| range(&levels[FLAT_ENDS..SAMPLES - FLAT_ENDS]));
    let middles = ranges.map(|(least, most)| (least + most) / 2.0);
    let (darkest, lightest) = range(&middles);
    let step = lightest - darkest;
    if step < FLAT_STEP {
        return false;
    }
    let flat = |at: f32| {
        let near =
            |&(least, most): &(f32, f32)| most - least < FLAT * step && ((least + most) / 2.0 - at).abs() < FLAT * step;
        ranges.iter().filter(|range| near(range)).count()
    };
    flat(darkest).min(flat(lightest)) >= FLAT_PROFILES
}
