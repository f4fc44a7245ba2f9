use serde_json::Value;

/// Kind of a JSON document that users write or keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Document {
    /// A task for `upm run` and the daemon.
    Job,
    /// Nominal figures of a rig.
    Rig,
    /// Measured response of a rig's plate.
    Library,
    /// Given pulses on given parts, for `upm simulate`.
    Experiment,
    /// Samples of the accelerometers during a pulse.
    Trace,
    /// The daemon's configuration.
    Daemon,
    /// Kinds of coins, for `upm locate`.
    Coins,
    /// Many runs of a job with draws, for `upm campaign`.
    Campaign,
}

impl Document {
    /// All kinds, in the order in which [`Document::of`] tests for them.
    pub const ALL: [Self; 8] =
        [Self::Library, Self::Experiment, Self::Trace, Self::Daemon, Self::Rig, Self::Job, Self::Coins, Self::Campaign];

    /// The kind of `value`, judged by its keys.
    pub fn of(value: &Value) -> Option<Self> {
        Self::ALL.into_iter().find(|document| document.is_of(value))
    }

    /// The kind that `schema` asks of `value`, and the kind it is instead. `None` without evidence of another kind.
    pub(crate) fn mistaken(value: &Value, schema: &Value) -> Option<(Self, Self)> {
        let wanted = Self::of(schema.get("properties")?)?;
        Self::of(value).filter(|_| !wanted.is_of(value)).map(|found| (wanted, found))
    }

    fn is_of(self, value: &Value) -> bool {
        let has = |key| value.get(key).is_some();
        // a job may have a list of tasks, and a rig may extend another one that has the motors
        has(self.key()) || self == Self::Job && has("tasks") || self == Self::Rig && has("extends")
    }

    /// The kind's name with its article.
    pub fn name(self) -> &'static str {
        self.facts()[0]
    }

    /// The command that takes this kind of document.
    pub fn command(self) -> &'static str {
        self.facts()[1]
    }

    /// The key that no other kind has; a job has it or `tasks`.
    pub fn key(self) -> &'static str {
        self.facts()[2]
    }

    fn facts(self) -> [&'static str; 3] {
        match self {
            Self::Job => ["a job", "upm run", "task"],
            Self::Rig => ["a rig", "upm calibrate --rig", "motors"],
            Self::Library => ["a COR library", "upm check", "entries"],
            Self::Experiment => ["an experiment", "upm simulate", "pulses"],
            Self::Trace => ["a trace", "upm-lab waveform-fit --trace", "counts"],
            Self::Daemon => ["a daemon's configuration", "upm serve --config", "plates"],
            Self::Coins => ["a set of coins", "upm locate --coins", "coins"],
            Self::Campaign => ["a campaign", "upm campaign", "seeds"],
        }
    }
}
