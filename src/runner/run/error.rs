use upm_core::rig::RigFault;
use upm_document::Fault;

/// Why a job was not run, or its run not written down.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A file is not valid, or not there.
    #[error("{}", one_a_line(.0))]
    Document(Vec<Fault>),
    /// The job cannot be run.
    #[error("{0}")]
    Job(Fault),
    /// The library is none or of another rig.
    #[error("{}", one_a_line(.0))]
    Library(Vec<Fault>),
    /// A file of the run folder could not be written.
    #[error("cannot write {path}: {reason}")]
    Write {
        /// Which.
        path: String,
        /// Why.
        reason: String,
    },
    /// The recording cannot go where it was said to go.
    #[error("--rerun: {0}")]
    RerunMode(String),
    /// The recording could not be started.
    #[error("recording: {0}")]
    Recording(String),
    /// The rig is not there for this run.
    #[error("rig: {0}")]
    Rig(#[from] RigFault),
}

impl From<Vec<Fault>> for RunError {
    fn from(faults: Vec<Fault>) -> Self {
        Self::Document(faults)
    }
}

impl RunError {
    /// One line for every fault.
    pub fn lines(&self) -> Vec<String> {
        self.to_string().lines().map(str::to_owned).collect()
    }

    /// True when the fault lies in what was given, not in the machine.
    pub fn is_bad_input(&self) -> bool {
        matches!(self, Self::Document(_) | Self::Job(_) | Self::Library(_) | Self::RerunMode(_))
    }
}

fn one_a_line(faults: &[Fault]) -> String {
    faults.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}
