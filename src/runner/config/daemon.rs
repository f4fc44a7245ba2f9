use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;

use super::daemon_file::{BetweenJobs, DaemonFile, KeepSpec, PlateEntry, StandingStart, WatchdogSpec};
use super::job::JobSpec;
use super::read::{NAMES, Origin, is_plain_name};
use super::rig::RigSpec;
use upm_core::document::{Diagnostic, Diagnostics, Path, one_of, parse_and_build, quoted, text_of};
use upm_core::job::Pace;
use upm_recording::RerunMode;

/// Validated daemon file: plates, limits and folders of a daemon.
#[derive(Clone, Debug, PartialEq)]
pub struct DaemonSpec {
    /// Name of the file in faults.
    pub file: String,
    /// Address and port to listen on.
    pub listen: SocketAddr,
    /// Address and port of the listener for emergency stops alone, if there is one.
    pub stop_listen: Option<SocketAddr>,
    /// Path below which page and API are served, without a `/` at its end; empty for the root.
    pub base_path: String,
    /// Folder of the job store, run folders and latches.
    pub data: PathBuf,
    /// The plates, in the order of the file.
    pub plates: Vec<PlateSpec>,
    /// Name of the plate for jobs that name none, if there is one.
    pub default_plate: Option<String>,
    /// Most jobs that may wait for one plate.
    pub queue: usize,
    /// Default pace of jobs.
    pub pace: Pace,
    /// Host names under which the daemon is reached besides its address and localhost, in lower case and without a
    /// port; addresses in canonical form, without brackets.
    pub hosts: Vec<String>,
    /// File of the token that permits everything.
    pub token_file: Option<PathBuf>,
    /// File of the token that permits reading and emergency stops only.
    pub read_token_file: Option<PathBuf>,
    /// Retention limits for jobs that have ended.
    pub keep: KeepSpec,
    /// Free disk space below which no job is accepted, bytes.
    pub min_free_bytes: u64,
    /// Limits at which the watchdog stops a plate.
    pub watchdog: WatchdogSpec,
    /// Destination of the runs' recordings; `None` for a file where this build can record.
    pub rerun: Option<RerunMode>,
    /// True to accept jobs with simulated faults.
    pub allow_faults: bool,
}

/// A plate of the daemon.
#[derive(Clone, Debug, PartialEq)]
pub struct PlateSpec {
    /// Name of the plate, valid as a file name.
    pub name: String,
    /// Validated rig that the plate belongs to.
    pub rig: RigSpec,
    /// Path of its COR library: the plate's, else the rig's.
    pub library: PathBuf,
    /// Key that names the library's file, for faults.
    pub library_key: String,
    /// True if the plate pauses after each job.
    pub waits_after_jobs: bool,
    /// Job that runs whenever the plate's queue is empty.
    pub standing: Option<StandingSpec>,
}

/// The standing job of a plate: it runs whenever the plate's queue is empty.
#[derive(Clone, Debug, PartialEq)]
pub struct StandingSpec {
    /// The job, with the plate's rig.
    pub job: JobSpec,
    /// True if the job waits for an operator after the daemon's start.
    pub starts_paused: bool,
}

impl DaemonSpec {
    /// Reads and validates the daemon file at `path` and the rigs it names. Errors list every fault.
    pub fn load(path: &std::path::Path) -> Result<Self, Vec<Diagnostic>> {
        Self::from_json(&text_of(path)?, &Origin::of_file(path))
    }

    /// Validates the daemon file in `text`. Errors list every fault.
    pub fn from_json(text: &str, origin: &Origin) -> Result<Self, Vec<Diagnostic>> {
        parse_and_build(text, &origin.file, |file, faults| Self::build(file, origin, faults))
    }

    fn build(file: DaemonFile, origin: &Origin, faults: &mut Diagnostics) -> Option<Self> {
        let root = Path::root();
        let listen = address_in("listen", &file.listen, faults);
        let stop_listen = file.stop_listen.as_ref().and_then(|text| address_in("stop_listen", text, faults));
        let plates = plates_of(&file.plates, origin, faults);
        let default_plate = default_plate_of(&file, faults);
        let hosts = hosts_of(&file.hosts, faults);
        let base_path = file.base_path.clone().unwrap_or_default();
        let is_path = |path: &String| path.strip_prefix('/').is_some_and(|rest| rest.split('/').all(is_plain_name));
        let allowed = "a path like /upm, without `/` at its end, of ASCII letters, digits, `.`, `_`, `-`";
        faults.require(file.base_path.as_ref().is_none_or(is_path), root.key("base_path"), quoted(&base_path), allowed);
        let mut file_of = |key: &str, named: &str| origin.named_file(named, &root.key(key), faults);
        let data = file_of("data", &file.data);
        let token_file = file.token_file.as_ref().and_then(|named| file_of("token_file", named));
        let read_token_file = file.read_token_file.as_ref().and_then(|named| file_of("read_token_file", named));
        let rerun = file.rerun.as_ref().and_then(|text| rerun_of(text, faults));
        // 0 is a free port of the system's choice
        let listened = listen.map(|address| address.port()).filter(|port| *port != 0);
        if let Some(found) = stop_listen.map(|address| address.port()).filter(|port| listened == Some(*port)) {
            faults.push(root.key("stop_listen"), found, "a port that nothing else here has");
        }
        Some(Self {
            file: origin.file.clone(),
            listen: listen?,
            stop_listen,
            base_path,
            data: data?,
            plates: plates?,
            default_plate,
            queue: file.queue as usize,
            pace: file.pace,
            hosts,
            token_file,
            read_token_file,
            keep: file.keep,
            min_free_bytes: file.disk.min_free_bytes,
            watchdog: file.watchdog,
            rerun,
            allow_faults: file.allow_faults,
        })
    }

    /// The plate called `name`.
    pub fn plate(&self, name: &str) -> Option<&PlateSpec> {
        self.plates.iter().find(|plate| plate.name == name)
    }

    /// Names of the plates, in the order of the file.
    pub fn plate_names(&self) -> Vec<String> {
        self.plates.iter().map(|plate| plate.name.clone()).collect()
    }
}

fn address_in(key: &str, text: &str, faults: &mut Diagnostics) -> Option<SocketAddr> {
    let address = text.parse().ok();
    let found = quoted(text);
    let allowed = "an IP address and a port like 127.0.0.1:8750 or [::1]:8750";
    faults.require(address.is_some(), Path::root().key(key), found, allowed);
    address
}

/// All plates, or `None` with the faults of every one.
fn plates_of(entries: &[PlateEntry], origin: &Origin, faults: &mut Diagnostics) -> Option<Vec<PlateSpec>> {
    let plate_of = |(i, plate): (usize, &PlateEntry)| {
        let at = Path::root().key("plates").index(i);
        let name = quoted(&plate.name);
        faults.require(is_plain_name(&plate.name), at.key("name"), &name, format!("{NAMES}, all ASCII"));
        // case-insensitive file systems would map two latches to one file
        let twice = entries.iter().take(i).any(|before| before.name.eq_ignore_ascii_case(&plate.name));
        faults.require(!twice, at.key("name"), &name, "a name that no plate before has");
        let library = plate.library.as_ref().map(|named| origin.named_file(named, &at.key("library"), faults));
        let rig = RigSpec::from_source(plate.rig.clone(), origin, &at.key("rig"), faults)?;
        let (library, library_key) = match library {
            Some(library) => (library?, format!("{}: {}", origin.file, at.key("library"))),
            None => {
                if rig.library.is_none() {
                    let allowed = format!("a path (rig {} names no library)", rig.model.name);
                    faults.push_missing(at.key("library"), allowed);
                }
                (rig.library.clone()?, rig.library_key.clone())
            }
        };
        let standing = match &plate.standing_job {
            // It uses the plate's rig and names neither a library nor another plate. Faults carry its file's name.
            Some(entry) => {
                let at = at.key("standing_job").key("job");
                let path = origin.named_file(&entry.job, &at, faults)?;
                let job =
                    text_of(&path).and_then(|text| JobSpec::from_json(&text, &Origin::of_file(&path), Some(&rig)));
                let named_by = format!("{}: {at}", origin.file);
                let job = job.map_err(|others| faults.append_named(others, &named_by)).ok()?;
                let mut of_job = Diagnostics::of(&job.file);
                let (root, name) = (Path::root(), &plate.name);
                let allowed = format!("the rig of plate {name}, or nothing");
                of_job.require(rig.is_as_in(&job.rig.document), root.key("rig"), "another rig", allowed);
                let asked = job.document.plate.as_deref().unwrap_or(name);
                let allowed = format!("{name} or nothing (it is the standing job of that plate)");
                of_job.require(asked == name, root.key("plate"), quoted(asked), allowed);
                let allowed = format!("nothing (plate {name} has its library)");
                of_job.require(!job.names_library(), root.key("library"), "a library", allowed);
                faults.append_named(of_job.into_list(), &named_by);
                Some(StandingSpec { job, starts_paused: entry.start == StandingStart::Paused })
            }
            None => None,
        };
        let waits_after_jobs = plate.between_jobs == BetweenJobs::Wait;
        Some(PlateSpec { name: plate.name.clone(), rig, library, library_key, waits_after_jobs, standing })
    };
    let plates: Vec<Option<PlateSpec>> = entries.iter().enumerate().map(plate_of).collect();
    plates.into_iter().collect()
}

fn default_plate_of(file: &DaemonFile, faults: &mut Diagnostics) -> Option<String> {
    let names: Vec<&str> = file.plates.iter().map(|plate| plate.name.as_str()).collect();
    if let Some(named) = &file.default_plate {
        let is_plate = names.contains(&named.as_str());
        faults.require(is_plate, Path::root().key("default_plate"), quoted(named), one_of(named, &names));
    }
    let only = if let [only] = names[..] { Some(only.to_owned()) } else { None };
    file.default_plate.clone().or(only)
}

/// Names as in a Host header, without the port.
fn hosts_of(names: &[String], faults: &mut Diagnostics) -> Vec<String> {
    for (i, host) in names.iter().enumerate() {
        let at = Path::root().key("hosts").index(i);
        let allowed = "a host name or IP address without a port like lab.example.org";
        faults.require(is_host(host), &at, quoted(host), allowed);
    }
    // an address can be written in many forms
    let canonical = |host: &String| {
        address_of(host).map_or_else(|| host.to_ascii_lowercase(), |address| address.to_canonical().to_string())
    };
    names.iter().map(canonical).collect()
}

/// The IP address in `host`, with or without brackets.
fn address_of(host: &str) -> Option<IpAddr> {
    let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    bare.parse().ok()
}

fn is_host(host: &str) -> bool {
    let label = |label: &str| {
        let plain = label.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_');
        (1..=63).contains(&label.len()) && plain && !label.starts_with('-') && !label.ends_with('-')
    };
    address_of(host).is_some() || (host.len() <= 253 && host.split('.').all(label))
}

/// The destination of recordings in `text`: a daemon starts no viewer.
fn rerun_of(text: &str, faults: &mut Diagnostics) -> Option<RerunMode> {
    let mode = text.parse().ok().filter(|mode| *mode != RerunMode::Spawn);
    faults.require(mode.is_some(), Path::root().key("rerun"), quoted(text), "one of off, save, connect, connect=URL");
    mode
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hosts_are_in_the_form_that_requests_are_compared_in() {
        let mut faults = Diagnostics::of("daemon.json");
        let written = ["Lab.Example", "[fe80:0::1]", "FE80::00:2", "[::ffff:10.0.0.7]", "10.0.0.8"].map(str::to_owned);
        let hosts = hosts_of(&written, &mut faults);
        assert_eq!(hosts, ["lab.example", "fe80::1", "fe80::2", "10.0.0.7", "10.0.0.8"]);
        assert!(faults.into_result(Some(())).is_ok());
    }
}
