use std::path::Path;

use serde_json::{Value, json};

use super::args::{CheckArgs, Common, SchemaArgs};
use super::failure::Failure;
use super::{BAD_INPUT, print_json};
use crate::config::{self, JobSpec, RigSpec, SimulateSpec};
use crate::library::Library;
use crate::run::{check_simulate, job_library};

/// What a file turned out to be: a line for people, or its faults.
type Finding = Result<String, Vec<String>>;

pub(super) fn check(args: &CheckArgs, common: Common) -> Result<u8, Failure> {
    let findings: Vec<(&Path, Finding)> = args.files.iter().map(|path| (path.as_path(), check_file(path))).collect();
    let bad = findings.iter().any(|(_, finding)| finding.is_err());
    if common.json {
        let rows = findings.iter().map(|(path, finding)| {
            json!({
                "file": path,
                "valid": finding.is_ok(),
                "says": finding.as_ref().ok(),
                "faults": finding.as_ref().err(),
            })
        });
        print_json(&rows.collect::<Vec<_>>())?;
    } else {
        for (path, finding) in &findings {
            match finding {
                Ok(says) => say!("{}: ok, {says}", path.display())?,
                Err(faults) => faults.iter().for_each(|fault| complain!("upm: {fault}")),
            }
        }
    }
    Ok(if bad { BAD_INPUT } else { 0 })
}

/// Validates a file as what its keys say it is.
fn check_file(path: &Path) -> Finding {
    let value = std::fs::read_to_string(path).ok().and_then(|text| serde_json::from_str::<Value>(&text).ok());
    let has = |key: &str| value.as_ref().is_some_and(|value| value.get(key).is_some());
    if has("entries") {
        let library = Library::load(path).map_err(lines)?;
        Ok(format!("library of {}, {} motions", library.rig, library.entries.len()))
    } else if has("pulses") {
        let experiment = SimulateSpec::load(path).map_err(lines)?;
        check_simulate(&experiment).map_err(|error| vec![format!("{}: {error}", path.display())])?;
        Ok(format!("experiment, {} pulses on {} parts", experiment.pulses.len(), experiment.parts.len()))
    } else if has("counts") {
        let trace = config::load_trace(path).map_err(lines)?.trace;
        Ok(format!("trace, 4 channels of {} samples at {:.0} Hz", trace.len(), trace.sample_hz))
    } else if has("motors") {
        let rig = RigSpec::load(path).map_err(lines)?;
        Ok(format!("rig {}, {:.0} mm plate", rig.model.name, rig.model.plate_side_m * 1e3))
    } else {
        let job = JobSpec::load(path).map_err(lines)?;
        job.check_runnable().map_err(|fault| vec![fault.to_string()])?;
        job_library(&job).map_err(lines)?;
        Ok(format!("job {} on {}, parts: {}", job.name, job.rig.model.name, job.kinds_of_parts().len()))
    }
}

fn lines<F: std::fmt::Display>(faults: Vec<F>) -> Vec<String> {
    faults.iter().map(ToString::to_string).collect()
}

pub(super) fn schema(args: &SchemaArgs) -> Result<u8, Failure> {
    let Some(schema) = config::schema(&args.name) else {
        let names = config::schema_names().join(", ");
        return Err(Failure::bad_input(format!("schema: found {:?}, allowed: {names}", args.name)));
    };
    print_json(&schema)?;
    Ok(0)
}
