use rustix::fs::Mode;
use rustix::process::umask;

/// From now on the files that this process makes are its user's alone: folders 0700, files 0600. Those that are there
/// already in a data folder become so when its store is opened.
pub fn keep_files_private() {
    umask(Mode::RWXG | Mode::RWXO);
}
