use std::path::Path;

use super::RunError;
use crate::config::{JobLayout, JobSpec};
use upm_viewer::{Movie, MovieContext};

/// A movie of a run of `job` in a new file at `path`. It films the run whose facts it receives.
///
/// # Errors
/// A file that cannot be created.
pub fn movie(job: &JobSpec, path: &Path) -> Result<Movie, RunError> {
    let JobLayout { parts, targets_m, bins, paths, .. } = JobLayout::of(job);
    let noise_sd = std::array::from_fn(|level| job.rig.sim.camera.noise_sd(level as f64));
    Movie::create(path, MovieContext { parts, targets_m, bins, paths, noise_sd })
        .map_err(|error| RunError::write(path, &error))
}
