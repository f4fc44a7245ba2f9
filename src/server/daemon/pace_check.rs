use std::sync::Arc;
use std::thread;
use std::time::Duration;

use super::Prepared;
use upm_core::priority::go_first;
use upm_core::time::Clock;
use upm_library::Library;
use upm_runner::config::{DaemonSpec, PlateSpec};
use upm_runner::run::{PaceCheck, check_pace};

/// How long the check lasts.
const LASTING: Duration = Duration::from_secs(2);

impl Prepared {
    /// Measures how this computer keeps up with each plate of `spec` while all of them run in real time, about two
    /// seconds; names and results in the order of the configuration. Writes nothing.
    pub fn check_pace(
        &self,
        spec: &DaemonSpec,
        clock: &(dyn Clock + Sync),
    ) -> Vec<(String, Result<PaceCheck, String>)> {
        let run = |plate: &PlateSpec, library: &Arc<Library>| {
            go_first(true);
            check_pace(&plate.rig, library, clock, &thread::sleep, LASTING)
        };
        thread::scope(|scope| {
            let plates = spec.plates.iter().zip(&self.libraries);
            let checks: Vec<_> =
                plates.map(|(plate, library)| (plate, scope.spawn(move || run(plate, library)))).collect();
            let result = |check: thread::ScopedJoinHandle<'_, _>| {
                check.join().unwrap_or_else(|_| Err("the check panicked".to_owned()))
            };
            checks.into_iter().map(|(plate, check)| (plate.name.clone(), result(check))).collect()
        })
    }
}
