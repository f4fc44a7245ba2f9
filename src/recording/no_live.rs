use std::io;

/// Stands for the live stream of a plate where there is no Rerun: none can be made.
#[derive(Clone, Debug)]
pub enum LiveServer {}

impl LiveServer {
    /// Says that this build has none.
    pub fn start(_port: Option<u16>, _history_bytes: u64) -> io::Result<Self> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "this build has no Rerun"))
    }

    /// What a viewer would connect to.
    pub fn uri(&self) -> &str {
        match *self {}
    }

    /// Messages that would have been dropped.
    pub fn dropped(&self) -> u64 {
        match *self {}
    }
}
