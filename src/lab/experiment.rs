use super::{LabFault, LabRig, Outcome};

/// One of the papers' experiments.
#[derive(Clone, Copy, Debug)]
pub struct Experiment {
    /// What it is called on the command line.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// True where the weak prototype cannot show it: its motors saturate.
    pub strong_rig: bool,
    /// Makes it.
    pub run: fn(&LabRig) -> Result<Outcome, LabFault>,
}

/// All of them, in the order of the paper.
pub const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        name: "cor-steering",
        about: "Table 1: amplitudes step the centre of rotation, the accelerometers read where it went",
        strong_rig: false,
        run: super::cor_steering,
    },
    Experiment {
        name: WAVEFORM_FIT,
        about: "one pulse, the accelerometers' trace of it and the motion read from that",
        strong_rig: false,
        run: super::waveform_fit,
    },
    Experiment {
        name: "force-curve",
        about: "mean friction force of the pump against speed, the way to the belt's speed, friction of a disc",
        strong_rig: false,
        run: super::force_curve,
    },
    Experiment {
        name: "race-track",
        about: "snapshots of three coins on one rotation field",
        strong_rig: true,
        run: super::race_track,
    },
    Experiment {
        name: "two-parts",
        about: "two coins, four centres of rotation: the error of one large step and of several",
        strong_rig: true,
        run: super::two_parts,
    },
    Experiment {
        name: "cor-map",
        about: "every centre of a calibrated library, as read and as it truly is",
        strong_rig: false,
        run: super::cor_map,
    },
    Experiment {
        name: VISION,
        about: "the eyes in rendered pictures whose truth is known, easy ones and hard ones",
        strong_rig: false,
        run: super::vision,
    },
];

/// The experiment that reads a recorded trace as well.
pub const WAVEFORM_FIT: &str = "waveform-fit";

/// The experiment that can be made of any number of scenes.
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
