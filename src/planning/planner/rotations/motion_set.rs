//! The library's motions, each with a dial: amplitude and sustain of a pulse for a given distance, and its displacement
//! of any part.

use super::belt_table::{BeltSlice, BeltTable};
use crate::cor_library::Library;
use crate::planner::{PlannerParams, Rotation};
use upm_core::geometry::{Twist, Vec2, perp};

/// Rows and columns of sample positions that define an entry's typical belt, and their largest distance from the
/// centre.
const PLACES: i32 = 9;
const REACH: f64 = 0.85;
/// Amplitudes of the dial below the full one.
const AMPLITUDES: usize = 24;
/// Settings between two neighbours of the dial: from the strongest belt that gains by amplitude without sustain to full
/// amplitude with some, the distance is far from linear in both.
const BETWEEN: u32 = 4;
/// Entries whose typical belt is slower than this fraction of the fastest are not used: the dial makes short steps.
const STRONG: f64 = 0.35;
/// Margin added to the forecast coasting time, and the least rest after a pulse, s.
const STANDING_S: f64 = 3e-3;
const LEAST_REST_S: f64 = 8e-3;

/// One pulse: a motion and the distance that it carries on the motion's typical belt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pulse {
    /// Index into [`MotionSet::dials`].
    pub dial: usize,
    /// Signed distance on the typical belt, m; negative runs the drive in reverse.
    pub distance_m: f64,
}

/// Amplitude and sustain of a pulse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DialSetting {
    /// Fraction of the full amplitude, 0 to 1.
    pub amplitude: f64,
    pub sustain_s: f64,
}

impl DialSetting {
    /// Linear interpolation from this setting towards `other`.
    fn towards(self, other: Self, part: f64) -> Self {
        Self {
            amplitude: self.amplitude + part * (other.amplitude - self.amplitude),
            sustain_s: self.sustain_s + part * (other.sustain_s - self.sustain_s),
        }
    }
}

/// A pulse prepared for forecasts.
#[derive(Clone, Debug)]
pub(super) struct LibraryMotion {
    pub setting: DialSetting,
    /// Amplitude of the plate's twist, reversed for a reversed pulse.
    twist: Twist,
    slice: BeltSlice,
}

/// A motion of the library and its dial.
#[derive(Clone, Debug)]
pub(super) struct MotionDial {
    /// Index into the library.
    pub entry: usize,
    pub twist: Twist,
    /// Distances on the typical belt, rising, m, each with its setting.
    settings: Vec<(f64, DialSetting)>,
}

/// All motions that a planner uses.
#[derive(Clone, Debug)]
pub(super) struct MotionSet {
    pub table: BeltTable,
    pub dials: Vec<MotionDial>,
    attack_s: f64,
    frame_s: f64,
    exposure_s: f64,
}

impl MotionSet {
    pub fn new(library: &Library, params: &PlannerParams) -> Self {
        let table = BeltTable::new(library, params.max_sustain_s);
        let typical: Vec<f64> = library.entries.iter().map(|e| typical_mps(&e.pump, params.half_side_m)).collect();
        let fastest = typical.iter().copied().fold(0.0, f64::max);
        let strong =
            library.entries.iter().zip(typical).enumerate().filter(|(_, (_, speed))| *speed >= STRONG * fastest);
        let dials = strong.map(|(entry, (motion, speed))| MotionDial {
            entry,
            twist: motion.pump,
            settings: settings(&table, &motion.pump, speed),
        });
        let dials = dials.collect();
        let (frame_s, exposure_s) = (params.frame_s, params.exposure_s);
        Self { table, dials, attack_s: library.attack_s, frame_s, exposure_s }
    }

    /// Shortest and longest distance of a dial's pulses, m.
    pub fn range_m(&self, dial: usize) -> (f64, f64) {
        let settings = &self.dials[dial].settings;
        (settings.first().map_or(0.0, |d| d.0), settings.last().map_or(0.0, |d| d.0))
    }

    /// Amplitude and sustain of `pulse`.
    pub fn setting(&self, pulse: Pulse) -> DialSetting {
        let (settings, distance_m) = (&self.dials[pulse.dial].settings, pulse.distance_m.abs());
        let above = settings.partition_point(|d| d.0 < distance_m);
        match (above.checked_sub(1).map(|below| settings[below]), settings.get(above)) {
            (Some((low_m, low)), Some(&(high_m, high))) => low.towards(high, (distance_m - low_m) / (high_m - low_m)),
            (None, Some(&(first_m, first))) => {
                DialSetting { amplitude: first.amplitude * distance_m / first_m, sustain_s: first.sustain_s }
            }
            (Some((_, last)), None) => last,
            (None, None) => DialSetting { amplitude: 0.0, sustain_s: 0.0 },
        }
    }

    /// `pulse`, prepared for forecasts.
    pub fn motion(&self, pulse: Pulse) -> LibraryMotion {
        self.motion_of(&self.dials[pulse.dial].twist, self.setting(pulse), pulse.distance_m < 0.0)
    }

    /// The motion of a library entry's `twist` at `setting`.
    pub fn motion_of(&self, twist: &Twist, setting: DialSetting, reversed: bool) -> LibraryMotion {
        let signed = if reversed { -setting.amplitude } else { setting.amplitude };
        let twist = *twist * signed;
        LibraryMotion { setting, twist, slice: self.table.slice(twist.spin_radps, setting.sustain_s) }
    }

    /// `pulse` at its `setting`, with a rest until the slowest part is at rest after `coasts_s`.
    pub fn rotation(&self, pulse: Pulse, setting: DialSetting, coasts_s: f64) -> Rotation {
        let (entry, distance_m) = (self.dials[pulse.dial].entry, pulse.distance_m);
        let DialSetting { amplitude, sustain_s } = setting;
        Rotation { entry, distance_m, amplitude, sustain_s, rest_s: rest_s(coasts_s) }
    }

    /// Time from the start of a pulse until the camera has seen the parts at rest, s: whole frames.
    pub fn duration_s(&self, setting: DialSetting, coasts_s: f64) -> f64 {
        let all_s = 2.0 * self.attack_s + setting.sustain_s + rest_s(coasts_s) + self.exposure_s;
        (all_s / self.frame_s - 1e-6).ceil() * self.frame_s
    }

    /// Motions with a centre more than `nearest` radii from every one of these discs (position and radius, m).
    pub fn usable(&self, discs: impl Iterator<Item = (Vec2, f64)> + Clone, nearest: f64) -> Vec<usize> {
        let supports = |dial: &MotionDial| {
            discs.clone().all(|(p, radius_m)| {
                dial.twist.velocity_at(p).norm() > nearest * radius_m * dial.twist.spin_radps.abs()
            })
        };
        (0..self.dials.len()).filter(|&j| supports(&self.dials[j])).collect()
    }
}

impl LibraryMotion {
    /// Final position, m, and coasting time, s, of a part at `p` that moves `gain` times as far as measured.
    #[inline]
    pub fn carry(&self, p: Vec2, gain: f64) -> (Vec2, f64) {
        let belt = self.twist.velocity_at(p);
        let speed = belt.norm();
        if speed < 1e-9 {
            return (p, 0.0);
        }
        let travel = self.slice.at(speed / gain);
        let across_m = if self.twist.spin_radps < 0.0 { -travel.across_m } else { travel.across_m };
        let step = (belt * travel.along_m + perp(belt) * across_m) * (gain / speed);
        (p + step, travel.coasts_s)
    }

    /// Position halfway of a part that the motion carries from `from` to `end`, m: an arc, with a quarter of its
    /// deviation from the first direction.
    pub fn middle(&self, from: Vec2, end: Vec2) -> Vec2 {
        let along = self.twist.velocity_at(from).try_normalize(0.0).unwrap_or_default();
        let step = end - from;
        from + 0.25 * (step + along * step.dot(&along))
    }
}

/// Rest after a pulse whose slowest part is at rest after `coasts_s`, s.
fn rest_s(coasts_s: f64) -> f64 {
    (coasts_s + STANDING_S).max(LEAST_REST_S)
}

fn typical_mps(twist: &Twist, half_side_m: f64) -> f64 {
    let at = |k: i32| REACH * half_side_m * (2.0 * f64::from(k) / f64::from(PLACES - 1) - 1.0);
    let places = (0..PLACES * PLACES).map(|k| Vec2::new(at(k % PLACES), at(k / PLACES)));
    (places.map(|p| twist.velocity_at(p).norm_squared()).sum::<f64>() / f64::from(PLACES * PLACES)).sqrt()
}

/// Settings from the weakest belt that moves anything without sustain, over full amplitude, to the longest sustain.
fn settings(table: &BeltTable, twist: &Twist, typical_mps: f64) -> Vec<(f64, DialSetting)> {
    let weakest = (table.slowest_mps() / typical_mps).min(0.9);
    let weaker = (0..AMPLITUDES).map(|k| DialSetting {
        amplitude: libm::pow(weakest, 1.0 - k as f64 / (AMPLITUDES - 1) as f64),
        sustain_s: 0.0,
    });
    let longer = (1..=(table.sustains - 1) / 2)
        .map(|k| DialSetting { amplitude: 1.0, sustain_s: 2.0 * k as f64 * table.sustain_step_s });
    let distance_m = |setting: DialSetting| {
        let slice = table.slice(twist.spin_radps * setting.amplitude, setting.sustain_s);
        slice.at(typical_mps * setting.amplitude).along_m
    };
    let mut coarse: Vec<(f64, DialSetting)> = Vec::new();
    for setting in weaker.chain(longer) {
        push_longer(&mut coarse, distance_m(setting), setting);
    }
    let mut fine = Vec::new();
    for pair in coarse.windows(2) {
        for k in 0..BETWEEN {
            let setting = pair[0].1.towards(pair[1].1, f64::from(k) / f64::from(BETWEEN));
            push_longer(&mut fine, distance_m(setting), setting);
        }
    }
    if let Some(&(distance_m, setting)) = coarse.last() {
        push_longer(&mut fine, distance_m, setting);
    }
    fine
}

/// Adds a setting if it carries farther than those before.
fn push_longer(settings: &mut Vec<(f64, DialSetting)>, distance_m: f64, setting: DialSetting) {
    if distance_m > settings.last().map_or(0.0, |last| last.0) + 1e-7 {
        settings.push((distance_m, setting));
    }
}
