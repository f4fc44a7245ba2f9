use std::f64::consts::TAU;

use super::settings::{Setting, SettingAssignment, SettingInfo, assigned, find, infos};
use super::sweep::{Progress, Sweep};
use super::{ExperimentResult, LabFault, LabRig, feeder, mchip, rock, topple};

/// One of the experiments of the papers.
#[derive(Clone, Copy)]
pub struct Experiment {
    /// Name on the command line.
    pub name: &'static str,
    /// Description in one line.
    pub about: &'static str,
    /// True where the weak prototype cannot reproduce it because its motors saturate.
    pub strong_rig: bool,
    /// True where the simulated plate is the machine.
    pub on_rig: bool,
    /// Procedure of the experiment.
    pub method: &'static dyn Method,
}

impl Experiment {
    const fn on_rig(name: &'static str, about: &'static str, method: &'static dyn Method) -> Self {
        Self { name, about, strong_rig: false, on_rig: true, method }
    }

    const fn on_machine(name: &'static str, about: &'static str, method: &'static dyn Method) -> Self {
        Self { on_rig: false, ..Self::on_rig(name, about, method) }
    }

    const fn strong(self) -> Self {
        Self { strong_rig: true, ..self }
    }
}

/// Options of one experiment. Without any the published experiments are reproduced.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Request {
    /// Parameters that are set: a single machine with these values is measured.
    pub assignments: Vec<SettingAssignment>,
    /// The swept parameter, if any.
    pub sweep: Option<Sweep>,
}

/// A procedure whose machine can be set.
pub trait Method: Sync {
    /// Descriptions of the machine's parameters.
    fn settings(&self, rig: &LabRig) -> Vec<SettingInfo>;

    /// Runs the experiment.
    ///
    /// # Errors
    ///
    /// A parameter that is not allowed, or a rig that cannot carry out the experiment.
    fn run(&self, rig: &LabRig, request: &Request, progress: Progress<'_>) -> Result<ExperimentResult, LabFault>;
}

/// The procedure of an experiment on machines of type `M`.
#[derive(Clone, Copy, Debug)]
pub struct Procedure<M: 'static> {
    /// Parameters of the machine that can be set.
    pub settings: &'static [Setting<M>],
    /// The machine with default values.
    pub usual: fn(&LabRig) -> M,
    /// Measures one machine.
    pub measure: fn(&M, Progress<'_>) -> Result<ExperimentResult, LabFault>,
    /// Reproduces the published experiments.
    pub reproduce: fn(&LabRig, Progress<'_>) -> Result<ExperimentResult, LabFault>,
}

impl<M: Clone + Send + Sync> Method for Procedure<M> {
    fn settings(&self, rig: &LabRig) -> Vec<SettingInfo> {
        infos(self.settings, &(self.usual)(rig))
    }

    fn run(&self, rig: &LabRig, request: &Request, progress: Progress<'_>) -> Result<ExperimentResult, LabFault> {
        let machine = assigned(self.settings, &(self.usual)(rig), &request.assignments)?;
        match &request.sweep {
            Some(sweep) => {
                let setting = find(self.settings, &sweep.key)?;
                let measure = |value: f64| {
                    let mut machine = machine.clone();
                    setting.set(&mut machine, value)?;
                    (self.measure)(&machine, &|_| ())
                };
                sweep.run(measure, progress)
            }
            None if request.assignments.is_empty() => (self.reproduce)(rig, progress),
            None => (self.measure)(&machine, progress),
        }
    }
}

/// Parameters of the simulated plate that can be set for experiments on it.
const RIG_SETTINGS: &[Setting<LabRig>] = &[
    Setting::<LabRig>::number("friction", [0.01, 2.0], 1.0, |rig| &mut rig.penny.friction)
        .about("Coulomb friction between penny and plate"),
    Setting::<LabRig>::number("base_hz", [20.0, 200.0], TAU, |rig| &mut rig.model.base_radps)
        .about("base frequency of the drive"),
    Setting::<LabRig>::number("accelerometer_noise_mps2", [0.0, 10.0], 1.0, |rig| {
        &mut rig.sim.accelerometers.noise_mps2
    })
    .about("noise of a sample of the accelerometers"),
];

/// Those that act on a part, and those that act on a plate without parts.
const PART_SETTINGS: &[Setting<LabRig>] = RIG_SETTINGS.split_at(2).0;
const BARE_SETTINGS: &[Setting<LabRig>] = RIG_SETTINGS.split_at(1).1;

/// The procedure of an experiment on the simulated plate of a rig.
macro_rules! on_rig {
    ($make:path, $settings:expr) => {
        &Procedure {
            settings: $settings,
            usual: LabRig::clone,
            measure: |rig, _| $make(rig),
            reproduce: |rig, _| $make(rig),
        }
    };
}

/// The procedure of an experiment on a machine whose parameters are defined in its module.
macro_rules! machine {
    ($module:ident, $machine:ident) => {
        &Procedure {
            settings: $module::SETTINGS,
            usual: |_| $module::$machine::published(),
            measure: $module::measure,
            reproduce: $module::reproduce,
        }
    };
}

/// All experiments, in the order of the papers.
pub const EXPERIMENTS: &[Experiment] = &[
    Experiment::on_rig(
        "cor-steering",
        "Table 1: amplitudes step the centre of rotation, the accelerometers read where it went",
        on_rig!(super::cor_steering, BARE_SETTINGS),
    ),
    Experiment::on_rig(
        WAVEFORM_FIT,
        "one pulse, the accelerometers' trace of it and the motion read from that",
        on_rig!(super::waveform_fit, BARE_SETTINGS),
    ),
    Experiment::on_rig(
        "force-curve",
        "mean friction force of the pump against speed, the way to the belt's speed, friction of a disc",
        on_rig!(super::force_curve, PART_SETTINGS),
    ),
    Experiment::on_rig(
        "pulse-law",
        "one pulse: wave and envelope, displacement against the square of its length, and where that law stops",
        on_rig!(super::pulse_law, PART_SETTINGS),
    )
    .strong(),
    Experiment::on_rig(
        "field-span",
        "how many dimensions rigid rotations span, and how many the fields of as many centres",
        on_rig!(super::field_span, PART_SETTINGS),
    )
    .strong(),
    Experiment::on_rig(
        "race-track",
        "snapshots of three coins on one rotation field",
        on_rig!(super::race_track, PART_SETTINGS),
    )
    .strong(),
    Experiment::on_rig(
        "two-parts",
        "two coins, four centres of rotation: the error of one large step and of several",
        on_rig!(super::two_parts, PART_SETTINGS),
    )
    .strong(),
    Experiment::on_rig(
        "cor-map",
        "every centre of a calibrated library, as read and as it truly is",
        on_rig!(super::cor_map, BARE_SETTINGS),
    ),
    Experiment::on_rig(
        VISION,
        "vision on rendered pictures with ground truth, easy and hard",
        &Procedure { settings: &[], usual: LabRig::clone, measure: super::vision, reproduce: super::vision },
    ),
    Experiment::on_machine(
        "feeder",
        "a plate shaken along one line: feed rate against duty and against an external force",
        machine!(feeder, Feeder),
    ),
    Experiment::on_machine(
        "mchip",
        "a part on an array of resonators, impact by impact: jams, strobing, duty, sweeps (a minute)",
        machine!(mchip, MChip),
    ),
    Experiment::on_machine(
        "topple",
        "a part slides against a low ledge: the speed that topples it, trials, ledges that orient a batch",
        machine!(topple, Topple),
    ),
    Experiment::on_machine(
        "rock",
        "a block rocks on a table driven up and down: drives that keep it rocking, and how much else they keep",
        machine!(rock, Rock),
    ),
];

/// The experiment that can also evaluate a recorded trace.
pub const WAVEFORM_FIT: &str = "waveform-fit";

/// The experiment that accepts any number of scenes.
pub const VISION: &str = "vision";

/// The experiment called `name`.
pub fn experiment(name: &str) -> Option<&'static Experiment> {
    EXPERIMENTS.iter().find(|experiment| experiment.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_experiment_is_found_by_its_name_alone() {
        for (i, one) in EXPERIMENTS.iter().enumerate() {
            assert_eq!(experiment(one.name).map(|found| found.about), Some(one.about));
            assert!(EXPERIMENTS[..i].iter().all(|earlier| earlier.name != one.name), "{} stands twice", one.name);
            assert!(one.name.chars().all(|c| c.is_ascii_lowercase() || c == '-'), "{}", one.name);
        }
        assert!(experiment("").is_none());
    }
}
