use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::output::Failure;
use super::run_args::RunFolderArgs;

/// First file written into a run folder; its time is the start of the run.
const FIRST_FILE: &str = "effective.json";

/// Run folder that `args` name: a path, `last`, or the beginning of the name of a run in `--out`.
pub(super) fn run_folder(args: &RunFolderArgs) -> Result<PathBuf, Failure> {
    let RunFolderArgs { run, out } = args;
    let text = run.to_string_lossy();
    // a path to nothing is reported by the command that reads it
    if run.exists() || run.components().count() != 1 {
        return Ok(run.clone());
    }
    let mut runs = runs_in(out);
    let (shown_out, allowed) = (out.display(), "a run folder, a unique prefix of one's name, or last");
    let wrong = |rest: String| Failure::bad_input(format!("RUN: expected {rest}"));
    if text == LAST {
        let newest = runs.into_iter().max_by(|a, b| (a.began_at, &a.name).cmp(&(b.began_at, &b.name)));
        let none = || wrong(format!("{allowed} (--out DIR), found no runs in {shown_out}"));
        return newest.map(|run| run.path).ok_or_else(none);
    }
    runs.sort_by(|a, b| a.name.cmp(&b.name));
    let name = |run: &OpenRun| run.name.clone();
    match only_one(&text, &runs, name, |name| name.starts_with(&*text), name) {
        Ok(Some(run)) => Ok(run.path.clone()),
        Ok(None) => Err(wrong(format!("{allowed} in {shown_out} (--out DIR), found {text:?}"))),
        Err(several) => Err(wrong(format!("more of the name of one of {several}; found {text:?}"))),
    }
}

struct OpenRun {
    name: String,
    path: PathBuf,
    began_at: SystemTime,
}

/// Run folders in `out` and in its folders of batches.
fn runs_in(out: &Path) -> Vec<OpenRun> {
    let mut runs = Vec::new();
    for folder in folders_in(out) {
        match run_at(&folder) {
            Some(run) => runs.push(run),
            None => runs.extend(folders_in(&folder).iter().filter_map(|folder| run_at(folder))),
        }
    }
    runs
}

pub(super) fn folders_in(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect()
}

/// The run in `folder`, if it is a run folder.
fn run_at(folder: &Path) -> Option<OpenRun> {
    let began_at = fs::metadata(folder.join(FIRST_FILE)).ok()?.modified().ok()?;
    let name = folder.file_name()?.to_string_lossy().into_owned();
    Some(OpenRun { name, path: folder.to_owned(), began_at })
}

/// Word that selects the newest name.
pub(super) const LAST: &str = "last";

/// Most candidates listed in a message.
const SHOWN: usize = 6;

/// The item whose name is `text`, else the only one whose name fits. If several do, the error has their number and the
/// first of them as `shown` writes them.
pub(super) fn only_one<'a, T>(
    text: &str,
    items: &'a [T],
    name: impl Fn(&T) -> String,
    fits: impl Fn(&str) -> bool,
    shown: impl Fn(&T) -> String,
) -> Result<Option<&'a T>, String> {
    if let Some(item) = items.iter().find(|item| name(item) == text) {
        return Ok(Some(item));
    }
    let found: Vec<&T> = items.iter().filter(|item| fits(&name(item))).collect();
    if found.len() < 2 {
        return Ok(found.into_iter().next());
    }
    let candidates = found.iter().take(SHOWN).map(|item| shown(item)).collect::<Vec<_>>().join(", ");
    let more = match found.len().saturating_sub(SHOWN) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    Err(format!("{}: {candidates}{more}", found.len()))
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::time::Duration;

    use tempfile::TempDir;

    use super::*;

    /// A folder with runs that began in this order.
    fn out_of(runs: &[&str]) -> TempDir {
        let out = TempDir::new().unwrap();
        for (begun, run) in runs.iter().enumerate() {
            let folder = out.path().join(run);
            fs::create_dir_all(&folder).unwrap();
            let file = File::create(folder.join(FIRST_FILE)).unwrap();
            file.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(begun as u64)).unwrap();
        }
        out
    }

    fn found(out: &Path, run: &str) -> Result<PathBuf, String> {
        let args = RunFolderArgs { run: run.into(), out: out.to_owned() };
        let found = run_folder(&args).map_err(|failure| failure.lines.join("\n"))?;
        Ok(found.strip_prefix(out).map_or(found.clone(), Path::to_owned))
    }

    #[test]
    fn last_is_the_run_that_began_last_also_in_a_batch() {
        let out = out_of(&["zebra-1", "ring-seeds-x/ring-9", "arrange-2"]);
        assert_eq!(found(out.path(), "last"), Ok("arrange-2".into()));
        let out = out_of(&["zebra-1", "arrange-2", "ring-seeds-x/ring-9"]);
        assert_eq!(found(out.path(), "last"), Ok("ring-seeds-x/ring-9".into()));
        let none = found(&out.path().join("zebra-1"), "last").unwrap_err();
        assert!(none.contains(", found no runs in "), "{none}");
    }

    #[test]
    fn unique_prefix_is_enough_and_candidates_of_another_are_listed() {
        let out = out_of(&["plus-sign-7-a", "plus-sign-7-b", "hold-4-1", "batch/plus-sign-9"]);
        fs::create_dir(out.path().join("hold-4-1-tables")).unwrap();
        assert_eq!(found(out.path(), "hold"), Ok("hold-4-1".into()));
        assert_eq!(found(out.path(), "plus-sign-9"), Ok("batch/plus-sign-9".into()));
        let said =
            "RUN: expected more of the name of one of 3: plus-sign-7-a, plus-sign-7-b, plus-sign-9; found \"plus\"";
        assert_eq!(found(out.path(), "plus"), Err(said.into()));
        assert!(found(out.path(), "arrange").unwrap_err().contains("expected a run folder, a unique prefix of"));
    }

    #[test]
    fn path_is_left_as_it_is() {
        let out = out_of(&["a-1"]);
        let path = out.path().join("a-1");
        assert_eq!(found(out.path(), path.to_str().unwrap()), Ok("a-1".into()));
        assert_eq!(found(out.path(), "no/such/run"), Ok("no/such/run".into()));
    }
}

#[cfg(test)]
mod prefix_tests {
    use super::*;

    #[test]
    fn whole_name_wins_over_longer_ones_and_long_lists_are_cut() {
        let names = ["arrange-2", "arrange-24", "hold-4"];
        let found = |text: &str| {
            let fits = |name: &str| name.starts_with(text);
            only_one(text, &names, ToString::to_string, fits, ToString::to_string).map(|name| name.copied())
        };
        assert_eq!(found("arrange-2"), Ok(Some("arrange-2")));
        assert_eq!(found("h"), Ok(Some("hold-4")));
        assert_eq!(found("arr"), Err("2: arrange-2, arrange-24".to_owned()));
        assert_eq!(found("arrange-3"), Ok(None));
        let names: Vec<String> = (0..8).map(|i| format!("run-{i}")).collect();
        let all = only_one("", &names, String::clone, |_| true, String::clone).unwrap_err();
        assert_eq!(all, "8: run-0, run-1, run-2, run-3, run-4, run-5 and 2 more");
    }
}
