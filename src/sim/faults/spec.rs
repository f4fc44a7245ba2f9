//! Vocabulary of faults, and the data of one fault.

use upm_core::coded_enum;
use upm_core::time::PlateTime;

/// A component of the rig, with its index where there are several.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FaultyComponent {
    /// The camera and its cable.
    Camera,
    /// The light over the plate.
    Light,
    /// The space between the camera and the plate.
    View,
    /// One voice coil with its amplifier, 0 to 3: x1, x2, y1, y2.
    Coil(usize),
    /// All four voice coils with their amplifiers.
    Coils,
    /// One accelerometer channel, 0 to 3: x1, y1, x2, y2.
    Accelerometer(usize),
    /// One part, in the order of the job.
    Part(usize),
    /// Every part of the job.
    Parts,
    /// The moving plate: its surface, level and springs.
    Plate,
    /// The controller between computer and plate.
    Device,
    /// The camera's clock.
    Clock,
}

impl FaultyComponent {
    /// Components without an index.
    const SINGLE: [Self; 8] =
        [Self::Camera, Self::Light, Self::View, Self::Coils, Self::Parts, Self::Plate, Self::Device, Self::Clock];

    /// The component named `name`: `camera`, `coil0`, `part12`.
    pub fn named(name: &str) -> Option<Self> {
        let digits = name.trim_start_matches(|c: char| c.is_ascii_lowercase());
        let number = || digits.parse::<usize>().ok().filter(|_| digits.len() < 4);
        match &name[..name.len() - digits.len()] {
            class if digits.is_empty() => Self::SINGLE.into_iter().find(|component| component.class() == class),
            "coil" => number().filter(|&i| i < 4).map(Self::Coil),
            "accel" => number().filter(|&i| i < 4).map(Self::Accelerometer),
            "part" => number().map(Self::Part),
            _ => None,
        }
    }

    /// Its name in files.
    pub fn name(self) -> String {
        match self {
            Self::Coil(i) | Self::Accelerometer(i) | Self::Part(i) => format!("{}{i}", self.class()),
            _ => self.class().to_owned(),
        }
    }

    /// The name without an index: components of one class have the same kinds of faults.
    pub fn class(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Light => "light",
            Self::View => "view",
            Self::Coil(_) => "coil",
            Self::Coils => "coils",
            Self::Accelerometer(_) => "accel",
            Self::Part(_) => "part",
            Self::Parts => "parts",
            Self::Plate => "plate",
            Self::Device => "device",
            Self::Clock => "clock",
        }
    }

    /// The kinds of faults that the component can have.
    pub fn kinds(self) -> impl Iterator<Item = FaultKind> {
        let class = self.class();
        FaultKind::ALL.into_iter().filter(move |kind| kind.facts().0.contains(&class))
    }
}

/// Range of one value of a fault.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// Unit or meaning: `px`, `a coil`.
    pub name: &'static str,
    /// Least value allowed.
    pub min: f64,
    /// Largest value allowed.
    pub max: f64,
    /// True when only whole numbers are allowed.
    pub whole: bool,
}

const fn any(name: &'static str, min: f64, max: f64) -> ValueRange {
    ValueRange { name, min, max, whole: false }
}

const fn whole(name: &'static str, max: f64) -> ValueRange {
    ValueRange { name, min: 0.0, max, whole: true }
}

coded_enum! {
    /// Kinds of faults, each with its name in files.
    pub enum FaultKind {
        /// The picture no longer changes, but its time stamps do.
        Freeze = "freeze",
        /// Pictures delayed by this many frames, with fresh stamps; samples delayed by this many.
        Late = "late",
        /// Frames are lost, each with this probability.
        Drop = "drop",
        /// Black pictures.
        Dark = "dark",
        /// Pictures, or samples, of noise.
        Garbage = "garbage",
        /// The camera is knocked: the picture is shifted, px.
        Shift = "shift",
        /// The camera is knocked: the picture is turned, degrees.
        Rotate = "rotate",
        /// The picture is mirrored.
        Mirror = "mirror",
        /// The exposure is this many times as long: the picture is brighter by the same factor, and smeared.
        Exposure = "exposure",
        /// Light, force or reading multiplied by this factor.
        Gain = "gain",
        /// The light's level varies by ±30 % at this frequency, Hz.
        Flicker = "flicker",
        /// A hand covers this share of the view.
        Hand = "hand",
        /// A coin appears in the picture where none is, at this position, mm.
        Ghost = "ghost",
        /// No output.
        Dead = "dead",
        /// Wired with the wrong polarity.
        Reversed = "reversed",
        /// The output holds its last value.
        Stuck = "stuck",
        /// Two components have changed places.
        Swapped = "swapped",
        /// A slow amplifier: two poles at this frequency, Hz.
        LowPass = "low_pass",
        /// A loose contact: no current in this share of the frames.
        Chatter = "chatter",
        /// The reading has the wrong sign.
        Flip = "flip",
        /// The reading is clipped at this acceleration, m/s².
        Clipped = "clipped",
        /// Moved by hand, mm.
        Moved = "moved",
        /// Taken off the plate; at the end of the fault put back where it was.
        Removed = "removed",
        /// Friction times 1000.
        Glued = "glued",
        /// Friction times 0.001.
        Ice = "ice",
        /// Friction times this factor.
        Friction = "friction",
        /// The plate is pushed out of its rest position, mm, and swings back.
        Bumped = "bumped",
        /// The plate is not level: tilt, degrees about y.
        Tilt = "tilt",
        /// Natural frequencies times this factor.
        Resonance = "resonance",
        /// A spot with a tenth of the friction: position and radius, mm.
        Oil = "oil",
        /// The controller refuses pulses as if one were still playing.
        Busy = "busy",
        /// Pulses and frames fail with a device error.
        Error = "error",
        /// The controller hangs once, for this wall time, s.
        Hang = "hang",
        /// The controller ignores a stop.
        Deaf = "deaf",
        /// The camera's time stamps are off by this time, s.
        Skew = "skew",
    }
}

impl FaultKind {
    /// Ranges of its values, in order; at most three.
    pub fn values(self) -> &'static [ValueRange] {
        self.facts().1
    }

    /// Classes of the components that can have it, and the ranges of its values.
    fn facts(self) -> (&'static [&'static str], &'static [ValueRange]) {
        match self {
            Self::Freeze | Self::Dark | Self::Mirror => (&["camera"], &[]),
            Self::Late => (&["camera", "accel"], const { &[whole("frames or samples", 60.0)] }),
            Self::Drop => (&["camera"], SHARE),
            Self::Garbage => (&["camera", "accel"], &[]),
            Self::Shift => (&["camera"], const { &[any("px", -2000.0, 2000.0), any("px", -2000.0, 2000.0)] }),
            Self::Rotate => (&["camera"], const { &[any("degrees", -180.0, 180.0)] }),
            Self::Exposure => (&["camera"], const { &[any("a factor", 0.01, 100.0)] }),
            Self::Gain => (&["light", "coil", "coils", "accel"], const { &[any("a factor", -10.0, 10.0)] }),
            Self::Flicker => (&["light"], HZ),
            Self::Hand => (&["view"], SHARE),
            Self::Ghost => (&["view"], PLACE),
            Self::Dead | Self::Stuck => (&["coil", "coils", "accel"], &[]),
            Self::Reversed => (COILS, &[]),
            Self::Swapped => (&["coils", "parts"], const { &[whole("a number", 63.0), whole("a number", 63.0)] }),
            Self::LowPass => (COILS, HZ),
            Self::Chatter => (COILS, SHARE),
            Self::Flip => (&["accel"], &[]),
            Self::Clipped => (&["accel"], const { &[any("m/s²", 0.0, 1000.0)] }),
            Self::Moved => (&["part"], PLACE),
            Self::Removed | Self::Glued | Self::Ice => (&["part"], &[]),
            Self::Friction => (&["part", "parts"], const { &[any("a factor", 0.001, 1000.0)] }),
            Self::Bumped => (&["plate"], const { &[any("mm", -20.0, 20.0), any("mm", -20.0, 20.0)] }),
            Self::Tilt => (&["plate"], const { &[any("degrees", -10.0, 10.0)] }),
            Self::Resonance => (&["plate"], const { &[any("a factor", 0.1, 10.0)] }),
            Self::Oil => (&["plate"], const { &[PLACE[0], PLACE[1], any("mm", 0.0, 1000.0)] }),
            Self::Busy | Self::Error | Self::Deaf => (&["device"], &[]),
            Self::Hang => (&["device"], const { &[any("s", 0.0, 600.0)] }),
            Self::Skew => (&["clock"], const { &[any("s", -10.0, 10.0)] }),
        }
    }
}

const COILS: &[&str] = &["coil", "coils"];
const PLACE: &[ValueRange] = &[any("mm", -1000.0, 1000.0), any("mm", -1000.0, 1000.0)];
const SHARE: &[ValueRange] = &[any("a share", 0.0, 1.0)];
const HZ: &[ValueRange] = &[any("Hz", 0.01, 10_000.0)];

/// One fault: component, kind, values and time span.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaultSpec {
    /// Component that fails.
    pub component: FaultyComponent,
    /// How the component fails.
    pub kind: FaultKind,
    /// Values in the order of [`FaultKind::values`]; the rest is zero.
    pub values: [f64; 3],
    /// Onset.
    pub from: PlateTime,
    /// End; `None` for a fault that never ends.
    pub to: Option<PlateTime>,
}

impl FaultSpec {
    /// True when the fault is present at `now`.
    pub fn holds(&self, now: PlateTime) -> bool {
        now >= self.from && self.to.is_none_or(|to| now < to)
    }

    /// The two indices of a swap; `None` for another kind.
    pub(super) fn pair(&self) -> Option<[usize; 2]> {
        (self.kind == FaultKind::Swapped).then(|| [self.values[0] as usize, self.values[1] as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_belongs_to_a_component_and_is_found_by_its_name() {
        let classes =
            ["camera", "light", "view", "coil0", "coils", "accel3", "part12", "parts", "plate", "device", "clock"];
        let components: Vec<FaultyComponent> = classes.iter().filter_map(|name| FaultyComponent::named(name)).collect();
        assert_eq!(components.len(), classes.len());
        assert_eq!(components.iter().map(|c| c.name()).collect::<Vec<_>>(), classes);
        for kind in FaultKind::ALL {
            assert_eq!(FaultKind::of_code(kind.code()), Some(kind));
            assert!(components.iter().any(|component| component.kinds().any(|k| k == kind)), "{kind:?}");
            assert!(kind.values().len() <= 3);
        }
    }

    #[test]
    fn fault_holds_from_its_begin_to_its_end() {
        let at = PlateTime::from_secs;
        let fault = |to| FaultSpec {
            component: FaultyComponent::Camera,
            kind: FaultKind::Freeze,
            values: [0.0; 3],
            from: at(1.0),
            to,
        };
        assert_eq!([0.99, 1.0, 1.99, 2.0].map(|t| fault(Some(at(2.0))).holds(at(t))), [false, true, true, false]);
        assert!(fault(None).holds(at(1e6)));
    }
}
