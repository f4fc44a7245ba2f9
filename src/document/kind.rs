use serde_json::Value;

/// What a file that people write or keep is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Document {
    /// What is to be done, for `upm run` and the daemon.
    Job,
    /// A machine.
    Rig,
    /// What a machine's plate does, as measured.
    Library,
    /// Given pulses on given parts, for `upm simulate`.
    Experiment,
    /// Samples of the accelerometers.
    Trace,
    /// The daemon's configuration.
    Daemon,
}

impl Document {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Library, Self::Experiment, Self::Trace, Self::Daemon, Self::Rig, Self::Job];

    /// What `value` is meant to be, by its keys.
    pub fn of(value: &Value) -> Option<Self> {
        Self::ALL.into_iter().find(|document| value.get(document.key()).is_some())
    }

    /// What `value` was asked to be by `schema`, and what it is instead. `None` where nothing says that it is something
    /// else.
    pub(crate) fn mistaken(value: &Value, schema: &Value) -> Option<(Self, Self)> {
        let wanted = Self::of(schema.get("properties")?)?;
        let is_wanted = value.get(wanted.key()).is_some();
        Self::of(value).filter(|_| !is_wanted).map(|found| (wanted, found))
    }

    /// With its article.
    pub fn name(self) -> &'static str {
        match self {
            Self::Job => "a job",
            Self::Rig => "a rig",
            Self::Library => "a COR library",
            Self::Experiment => "an experiment",
            Self::Trace => "a trace",
            Self::Daemon => "a daemon's configuration",
        }
    }

    /// The command that takes it.
    pub fn command(self) -> &'static str {
        match self {
            Self::Job => "upm run",
            Self::Rig => "upm calibrate --rig",
            Self::Library => "upm check",
            Self::Experiment => "upm simulate",
            Self::Trace => "upm lab waveform-fit --trace",
            Self::Daemon => "upm serve --config",
        }
    }

    /// A key that this must have, and nothing else has.
    pub fn key(self) -> &'static str {
        match self {
            Self::Job => "task",
            Self::Rig => "motors",
            Self::Library => "entries",
            Self::Experiment => "pulses",
            Self::Trace => "counts",
            Self::Daemon => "plates",
        }
    }
}
