use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rustix::fs::{Access, Mode, access};
use rustix::process::umask;

use crate::http::{Scope, Tokens};
use upm_planning::cor_library::Library;
use upm_runner::config::{DaemonSpec, Diagnostic, PlateSpec, reason};
use upm_runner::run::{check_places, load_library};
use upm_viewer::RerunSink;

/// Largest token file that is read, bytes.
const LONGEST_TOKEN_FILE: u64 = 4096;

/// Inputs of a daemon's start, most of them read from the files that its configuration names.
#[derive(Debug)]
pub struct Prepared {
    /// Tokens that network clients must present.
    pub(super) tokens: Arc<Tokens>,
    /// The library of each plate, in the order of the configuration.
    pub(super) libraries: Vec<Arc<Library>>,
}

/// From now on files created by this process are accessible to its user alone: folders 0700, files 0600.
pub fn keep_files_private() {
    umask(Mode::RWXG | Mode::RWXO);
}

/// Reads the files that `spec` names and checks everything that can be checked before anything starts. Returns every
/// fault found. Starts and changes nothing.
pub fn prepare(spec: &DaemonSpec) -> Result<Prepared, Vec<Diagnostic>> {
    let mut faults = Vec::new();
    let tokens = tokens_of(spec, &mut faults);
    let taken = |plate: &PlateSpec| library_of(plate).map_err(|found| faults.extend(found)).ok();
    let libraries = spec.plates.iter().filter_map(taken).collect();
    if tokens.is_empty() && faults.is_empty() {
        let allowed =
            "an address of this machine alone, as 127.0.0.1:8750, or a `token_file`: others can reach this one";
        let own = [("listen", Some(spec.listen)), ("stop_listen", spec.stop_listen)];
        let reached = own.iter().filter_map(|(key, address)| Some((key, address.filter(|a| !a.ip().is_loopback())?)));
        faults.extend(reached.map(|(key, address)| fault(spec, key, address.to_string(), allowed)));
    }
    faults.extend(data_fault(spec));
    let rerun = spec.rerun.as_ref().and_then(|mode| RerunSink::check(mode).err());
    faults.extend(rerun.map(|error| fault(spec, "rerun", error.to_string(), "off, save, connect or connect=URL")));
    if !faults.is_empty() {
        return Err(faults);
    }
    let is_open = |file: &&PathBuf| fs::metadata(file).is_ok_and(|meta| meta.permissions().mode() & 0o077 != 0);
    for file in spec.token_file.iter().chain(&spec.read_token_file).filter(is_open) {
        tracing::warn!("{}: others on this machine may read this token", file.display());
    }
    if spec.token_file.is_none() && spec.read_token_file.is_some() {
        tracing::warn!("`read_token_file` alone lets no client submit, cancel, reset or resume; add a `token_file`");
    }
    Ok(Prepared { tokens: Arc::new(tokens), libraries })
}

fn fault(spec: &DaemonSpec, path: &str, found: String, allowed: &str) -> Diagnostic {
    Diagnostic::new(&spec.file, path, found, allowed)
}

/// Takes changed tokens from the files that `spec` names; while one is faulty, those before hold. Returns the faults,
/// which are logged unless they were there `before`.
pub(super) fn renew_tokens(spec: &DaemonSpec, tokens: &Tokens, before: &[Diagnostic]) -> Vec<Diagnostic> {
    let mut faults = Vec::new();
    let read = tokens_of(spec, &mut faults);
    if faults.is_empty() && tokens.replace(read) {
        tracing::warn!("tokens have changed: those before hold no longer");
    }
    let new = faults.iter().filter(|fault| !before.contains(fault));
    new.for_each(|fault| tracing::error!("the tokens before hold: {fault}"));
    faults
}

/// The tokens in the files that `spec` names; their faults are added to `faults`.
fn tokens_of(spec: &DaemonSpec, faults: &mut Vec<Diagnostic>) -> Tokens {
    let mut tokens = Tokens::default();
    let files =
        [("token_file", &spec.token_file, Scope::Operate), ("read_token_file", &spec.read_token_file, Scope::Read)];
    for (key, file, scope) in files {
        let Some(file) = file else { continue };
        let added = secret_in(file).and_then(|secret| tokens.add(scope.code(), &secret, scope));
        if let Err(wrong) = added {
            let allowed = "a file that holds one token: at least 32 visible ASCII characters";
            faults.push(fault(spec, key, format!("{}: {wrong}", file.display()), allowed));
        }
    }
    tokens
}

/// The token in a file. Error messages contain no part of it.
fn secret_in(file: &Path) -> Result<String, String> {
    let meta = fs::metadata(file).map_err(|error| reason(&error))?;
    if !meta.is_file() || meta.len() > LONGEST_TOKEN_FILE {
        return Err("no plain file, or too large".to_owned());
    }
    let text = fs::read_to_string(file).map_err(|error| reason(&error))?;
    Ok(text.trim_end().to_owned())
}

/// The library of a plate, on which the parts of its standing job must find places.
fn library_of(plate: &PlateSpec) -> Result<Arc<Library>, Vec<Diagnostic>> {
    let library = load_library(&plate.library, &plate.library_key, &plate.rig)?;
    if let Some(standing) = &plate.standing {
        check_places(&standing.job).map_err(|fault| vec![fault])?;
    }
    Ok(library)
}

/// The fault of a data folder that this process cannot write to or create; `None` for a usable one.
fn data_fault(spec: &DaemonSpec) -> Option<Diagnostic> {
    let there = spec.data.ancestors().find(|folder| folder.exists() || folder.as_os_str().is_empty())?;
    let there = if there.as_os_str().is_empty() { Path::new(".") } else { there };
    let writable = there.is_dir() && access(there, Access::WRITE_OK | Access::EXEC_OK).is_ok();
    let found = spec.data.display().to_string();
    (!writable).then(|| fault(spec, "data", found, "a folder that can be written, or made"))
}

#[cfg(test)]
mod tests {
    use axum::http::header::AUTHORIZATION;
    use axum::http::{HeaderMap, HeaderValue};

    use super::*;

    fn shipped() -> DaemonSpec {
        DaemonSpec::load(&Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs/daemon.json")).unwrap()
    }

    #[test]
    fn changed_token_holds_once_it_is_valid() {
        let folder = tempfile::tempdir().unwrap();
        let (file, mut spec) = (folder.path().join("token"), shipped());
        spec.token_file = Some(file.clone());
        fs::write(&file, "a".repeat(32)).unwrap();
        let tokens = tokens_of(&spec, &mut Vec::new());
        let admits = |letter: &str| {
            let bearer: HeaderValue = format!("Bearer {}", letter.repeat(32)).parse().unwrap();
            tokens.admit(&HeaderMap::from_iter([(AUTHORIZATION, bearer)]), Scope::Operate).is_ok()
        };
        fs::write(&file, "b").unwrap();
        let faults = renew_tokens(&spec, &tokens, &[]);
        assert_eq!((faults.len(), admits("a"), admits("b")), (1, true, false));
        fs::write(&file, "b".repeat(32)).unwrap();
        assert!(renew_tokens(&spec, &tokens, &faults).is_empty());
        assert_eq!((admits("a"), admits("b")), (false, true));
    }

    #[test]
    fn unwritable_data_folder_is_a_fault() {
        let data = tempfile::tempdir().unwrap();
        let fault_at = |data: &Path| {
            let mut spec = shipped();
            spec.data = data.to_owned();
            data_fault(&spec)
        };
        assert_eq!(fault_at(&data.path().join("made/when/need/be")), None);
        fs::write(data.path().join("file"), "").unwrap();
        assert!(fault_at(&data.path().join("file/below")).is_some());
        // root may write everywhere
        if !rustix::process::geteuid().is_root() {
            assert!(fault_at(Path::new("/usr/upm")).is_some());
        }
    }
}
