use std::f64::consts::TAU;

use super::settings::{Field, Setting, SettingInfo, assigned, find, settings};
use super::sweep::{Progress, Sweep};
use super::{ExperimentResult, LabError, LabRig, feeder, mchip, rock, topple};

/// One of the experiments of the papers.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Name on the command line.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// Where it runs.
    pub kind: Kind,
    /// Descriptions of the parameters of its machine.
    pub settings: fn(&LabRig) -> Vec<SettingInfo>,
    /// Its procedure.
    pub run: fn(&LabRig, &Request, Progress<'_>) -> Result<ExperimentResult, LabError>,
}

/// Where an experiment runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// On the simulated plate of a rig, or in rendered scenes.
    Plate,
    /// The same, by default of the strong prototype: the motors of the weak one saturate.
    StrongPlate,
    /// On a machine of its own module.
    Machine,
}

/// Options of one experiment. Without any the published experiments are reproduced.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Request {
    /// Parameters that are set: a single machine with these values is measured.
    pub assignments: Vec<(String, f64)>,
    /// The swept parameter, if any.
    pub sweep: Option<Sweep>,
}

/// Descriptions of the parameters of `machine`, which has default values.
fn described<M>(settings: &[Setting<M>], mut machine: M) -> Vec<SettingInfo> {
    let info = |setting: &Setting<M>| {
        let Setting { key, about, range, .. } = *setting;
        SettingInfo { key, about, range, usual: setting.value(&mut machine) }
    };
    settings.iter().map(info).collect()
}

/// Measures `machine`, or several of them in a sweep, with the parameters that are set.
///
/// # Errors
///
/// A parameter that is not allowed, or a rig that cannot carry out the experiment.
fn measured<M: Clone + Sync>(
    settings: &[Setting<M>],
    machine: &M,
    measure: fn(&M, Progress<'_>) -> Result<ExperimentResult, LabError>,
    request: &Request,
    progress: Progress<'_>,
) -> Result<ExperimentResult, LabError> {
    let machine = assigned(settings, machine, &request.assignments)?;
    let Some(sweep) = &request.sweep else { return measure(&machine, progress) };
    let setting = find(settings, &sweep.key)?;
    let at = |value: f64| {
        let mut machine = machine.clone();
        setting.set(&mut machine, value)?;
        measure(&machine, &|_| ())
    };
    sweep.run(at, progress)
}

/// Parameters of the simulated plate that can be set for experiments on it.
const RIG_SETTINGS: &[Setting<LabRig>] = settings! {
    "friction", [0.01, 2.0], 1.0, penny.friction, "Coulomb friction between penny and plate";
    "base_hz", [20.0, 200.0], TAU, model.base_radps, "base frequency of the drive";
    "accelerometer_noise_mps2", [0.0, 10.0], 1.0, sim.accelerometers.noise_mps2, "noise of a sample of the accelerometers";
};

/// Those that act on a part, and those that act on a plate without parts.
const PART: &[Setting<LabRig>] = RIG_SETTINGS.split_at(2).0;
const BARE: &[Setting<LabRig>] = RIG_SETTINGS.split_at(1).1;
const NONE: &[Setting<LabRig>] = &[];

/// Experiments, each by its kind, its name, its module and its settings or its machine, and its description.
macro_rules! experiments {
    (@ Machine $module:ident $machine:ident) => {
        ($module::SETTINGS, |_: &LabRig| $module::$machine::published(), $module::measure, $module::reproduce)
    };
    (@ $plate:ident $make:ident $settings:ident) => {
        ($settings, LabRig::clone, super::$make::$make, super::$make::$make)
    };
    ($($kind:ident, $name:expr, $module:ident, $item:ident, $about:literal;)+) => {
        &[$(Experiment {
            name: $name,
            about: $about,
            kind: Kind::$kind,
            settings: |rig| {
                let (settings, usual, ..) = experiments!(@ $kind $module $item);
                described(settings, usual(rig))
            },
            run: |rig, request, progress| {
                let (settings, usual, measure, reproduce) = experiments!(@ $kind $module $item);
                if *request == Request::default() {
                    return reproduce(rig, progress);
                }
                measured(settings, &usual(rig), measure, request, progress)
            },
        }),+]
    };
}

/// All experiments, in the order of the papers.
pub const EXPERIMENTS: &[Experiment] = experiments! {
    Plate, "cor-steering", cor_steering, BARE, "Table 1: amplitudes step the centre of rotation, the accelerometers read where it went";
    Plate, WAVEFORM_FIT, waveform_fit, BARE, "one pulse, the accelerometers' trace of it and the motion read from that";
    Plate, "force-curve", force_curve, PART, "mean friction force of the pump against speed, the way to the belt's speed, friction of a disc";
    StrongPlate, "pulse-law", pulse_law, PART, "one pulse: wave and envelope, displacement against the square of its length, and where that law stops";
    StrongPlate, "field-span", field_span, PART, "how many dimensions rigid rotations span, and how many the fields of as many centres";
    StrongPlate, "race-track", race_track, PART, "snapshots of three coins on one rotation field";
    StrongPlate, "two-parts", two_parts, PART, "two coins, four centres of rotation: the error of one large step and of several";
    Plate, "cor-map", cor_map, BARE, "every centre of a calibrated library, as read and as it truly is";
    Plate, VISION, vision, NONE, "vision on rendered pictures with ground truth, easy and hard";
    Machine, "feeder", feeder, Feeder, "a plate shaken along one line: feed rate against duty and against an external force";
    Machine, "mchip", mchip, MChip, "a part on an array of resonators, impact by impact: jams, strobing, duty, sweeps (a minute)";
    Machine, "topple", topple, Topple, "a part slides against a low ledge: the speed that topples it, trials, ledges that orient a batch";
    Machine, "rock", rock, Rock, "a block rocks on a table driven up and down: drives that keep it rocking, and how much else they keep";
};

/// The experiment that can also evaluate a recorded trace.
pub const WAVEFORM_FIT: &str = "waveform-fit";

/// The experiment that accepts any number of scenes.
pub const VISION: &str = "vision";
