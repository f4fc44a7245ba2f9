use std::fs::{self, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use jiff::Timestamp;
use serde_json::json;

use crate::cli::args::{BundleArgs, Common};
use crate::cli::output::{Failure, print};
use upm_core::files::write_whole;
use upm_runner::config::DaemonSpec;
use upm_server::daemon::{BundleSources, bundle};

/// Architecture and operating system of this build.
const TARGET: (&str, &str) = (std::env::consts::ARCH, std::env::consts::OS);

pub(crate) fn support_bundle(args: &BundleArgs, common: Common) -> Result<u8, Failure> {
    let now = Timestamp::now();
    let config = DaemonSpec::load(&args.config);
    let data = args.data.as_deref().or_else(|| config.as_ref().ok().map(|spec| spec.data.as_path()));
    let target = format!("{}-{}", TARGET.0, TARGET.1);
    let config = config.as_ref().map_err(Vec::as_slice);
    let sources = BundleSources { version: env!("CARGO_PKG_VERSION"), target: &target, now, config, data };
    let made = bundle(&sources).map_err(Failure::failed)?;
    let out = args.out.clone().unwrap_or_else(|| named(now));
    write(&out, &made.tar).map_err(|error| Failure::write(&out, error))?;
    let summary = json!({
        "bundle": out.display().to_string(),
        "bytes": made.tar.len(),
        "files": made.files,
        "missing": made.missing,
    });
    print(common.json, &summary, || {
        if !common.quiet {
            made.missing.iter().for_each(|missing| errln!("upm: not in the bundle: {missing}"));
        }
        let (out, files, kilobytes) = (out.display(), made.files.len(), made.tar.len() as f64 * 1e-3);
        outln!("{out}: {files} files, {kilobytes:.1} kB; look through it before you send it")
    })
}

fn named(now: Timestamp) -> PathBuf {
    PathBuf::from(format!("upm-support-{}.tar", now.strftime("%Y%m%dT%H%M%SZ")))
}

/// Writes the archive atomically, readable by its owner only.
fn write(out: &Path, tar: &[u8]) -> io::Result<()> {
    let mut draft = out.as_os_str().to_owned();
    draft.push(".part");
    let written = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&draft)
        .and_then(|file| write_whole(file, Path::new(&draft), out, tar));
    if written.as_ref().is_err_and(|error| error.kind() != io::ErrorKind::AlreadyExists) {
        fs::remove_file(&draft).ok();
    }
    written
}
