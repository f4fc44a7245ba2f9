use std::fmt;
use std::str::FromStr;

/// Destination of a run's Rerun recording: `off`, `save`, `connect`, `connect=URL` or `spawn`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum RerunMode {
    /// No recording.
    Off,
    /// Into the run folder.
    #[default]
    Save,
    /// Into the run folder and to a running viewer.
    Connect {
        /// The viewer's address, `rerun+http://HOST:PORT/proxy`; `None` for a viewer on this machine.
        url: Option<String>,
    },
    /// Into the run folder and to a viewer started for it.
    Spawn,
}

impl FromStr for RerunMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once('=') {
            None if text == "off" => Ok(Self::Off),
            None if text == "save" => Ok(Self::Save),
            None if text == "connect" => Ok(Self::Connect { url: None }),
            None if text == "spawn" => Ok(Self::Spawn),
            Some(("connect", url)) if !url.is_empty() => Ok(Self::Connect { url: Some(url.to_owned()) }),
            _ => Err(format!("expected one of off, save, connect, connect=URL, spawn, found {text:?}")),
        }
    }
}

impl fmt::Display for RerunMode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => f.write_str("off"),
            Self::Save => f.write_str("save"),
            Self::Connect { url: None } => f.write_str("connect"),
            Self::Connect { url: Some(url) } => write!(f, "connect={url}"),
            Self::Spawn => f.write_str("spawn"),
        }
    }
}
