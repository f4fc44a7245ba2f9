//! Program and machine of a run: on others its last digits may be others.

use std::fs;
use std::hash::{DefaultHasher, Hasher};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::LazyLock;

use serde_json::Value;

/// Processor and C library that this program is built for.
const TARGET: [&str; 2] = [
    if cfg!(target_arch = "x86_64") { "x86_64" } else { "another processor" },
    if cfg!(target_env = "gnu") { "glibc" } else { "another C library" },
];

/// Bytes at the end of a program in which each build has its own: names of functions and sizes of sections.
const END_BYTES: i64 = 1 << 18;

/// Hash of the end of the file that this code is in: the program, or a module that another program has loaded.
static BUILD: LazyLock<u64> = LazyLock::new(|| {
    let (mut end, mut hasher) = (Vec::new(), DefaultHasher::new());
    let read = |mut file: fs::File| file.seek(SeekFrom::End(-END_BYTES)).and_then(|_| file.read_to_end(&mut end));
    // without the file all builds are alike
    own_file().and_then(|path| fs::File::open(path).and_then(read).ok());
    hasher.write(&end);
    hasher.finish()
});

/// The file from which the code at this function was loaded.
fn own_file() -> Option<String> {
    let (address, maps) = (own_file as fn() -> Option<String> as usize, fs::read_to_string("/proc/self/maps").ok()?);
    let is_here = |line: &&str| {
        let range = line.split(' ').next().and_then(|range| range.split_once('-'));
        let [from, to] =
            range.map_or([0, 0], |(from, to)| [from, to].map(|at| usize::from_str_radix(at, 16).unwrap_or(0)));
        (from..to).contains(&address)
    };
    let line = maps.lines().find(is_here)?;
    let (path, program) = (&line[line.find('/')?..], "/proc/self/exe");
    // the program's own name may be another file's by now
    let is_program = fs::read_link(program).is_ok_and(|link| link == Path::new(path));
    Some(if is_program { program } else { path }.to_owned())
}

/// Hash of this program.
pub fn program() -> String {
    format!("{:016x}", *BUILD)
}

/// This program and its machine.
pub fn maker() -> String {
    format!("upm {} on {}", env!("CARGO_PKG_VERSION"), machine())
}

/// The program and machine that made the run in folder `run`; `None` where it does not say so.
pub fn maker_of(run: &Path) -> Option<String> {
    let effective: Value = serde_json::from_str(&fs::read_to_string(run.join("effective.json")).ok()?).ok()?;
    Some(format!("upm {} on {}", effective["version"].as_str()?, effective["machine"].as_str()?))
}

/// The processor, with the extensions by which the C library and this program choose functions, and the C library.
pub(super) fn machine() -> String {
    #[cfg(target_arch = "x86_64")]
    let has_fma = std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    let has_fma = false;
    let [processor, library] = TARGET;
    let extensions = if has_fma { " with avx2 and fma" } else { "" };
    format!("{processor}{extensions}, {library}, build {}", program())
}
