//! `upm export --lerobot`: a data set in the layout v3.0 of LeRobot, a run an episode, a cycle a frame. The run folders
//! go with it, below `meta/upm`: every episode can be repeated, and every row made again.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::{fs, io, mem, slice};

use serde::Deserialize;
use serde_json::{Map, Value, json};

use super::files::{Drafts, draft_of, provenance, read_lines, report_of};
use super::parquet_file::ParquetFile;
use super::tables::{Column, Table, numbers};
use crate::cli::output::Failure;
use crate::cli::run_folder::folders_in;

/// Files of a data set: frames, episodes, tasks, metadata, statistics.
const FILES: [&str; 5] = [
    "data/chunk-000/file-000.parquet",
    "meta/episodes/chunk-000/file-000.parquet",
    "meta/tasks.parquet",
    "meta/info.json",
    "meta/stats.json",
];
/// Folder of the run folders, and what of those is kept.
const RUNS: &str = "meta/upm";
const KEPT: [&str; 3] = ["effective.json", "journal.jsonl", "report.json"];

/// Columns of the tables, and metadata, that all data sets have in common.
#[derive(Default, Deserialize)]
struct Layout {
    frames: Table,
    episodes: Table,
    tasks: Table,
    /// `info.json`; in names of numbers in a list `#` is the number of the part.
    info: Value,
    /// By this pandas reads the text of a task as the index of the row, as LeRobot expects it.
    pandas: Value,
}

static LAYOUT: LazyLock<Layout> = LazyLock::new(|| {
    let layout = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/lerobot-layout.json"));
    serde_json::from_str(layout).unwrap_or_default()
});

/// Run folders of the episodes of the data set in `folder`; empty where that is no data set of this program.
pub(crate) fn episodes_in(folder: &Path) -> Vec<PathBuf> {
    let mut episodes = folders_in(&folder.join(RUNS));
    episodes.sort();
    episodes
}

/// Files of the data set in `folder` that differ from what its run folders give.
pub(crate) fn differing_files(folder: &Path, show: impl FnMut(f64, &Path)) -> Result<Vec<String>, Failure> {
    let again = std::env::temp_dir().join(format!("upm-verify-{}", std::process::id()));
    let _made = Drafts(vec![again.clone()]);
    write(&again, &episodes_in(folder), show)?;
    let differs = |file: &&&str| fs::read(folder.join(file)).ok() != fs::read(again.join(file)).ok();
    Ok(FILES.iter().filter(differs).map(|file| folder.join(file).display().to_string()).collect())
}

/// Writes `runs` as the data set `folder`, which has its name once it is whole; the number of frames.
pub(super) fn write(folder: &Path, runs: &[PathBuf], mut show: impl FnMut(f64, &Path)) -> Result<u64, Failure> {
    if folder.is_file() || fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()) {
        let found = folder.display();
        return Err(Failure::bad_input(format!("--lerobot: expected a new or an empty folder, found {found}")));
    }
    let failed = |error| Failure::write(folder, error);
    let draft = draft_of(folder);
    // an export that was killed leaves its draft
    if draft.join(FILES[0]).is_file() {
        fs::remove_dir_all(&draft).map_err(failed)?;
    }
    let made = draft.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::create_dir(&draft));
    made.map_err(|error| Failure::write(&draft, error))?;
    let _draft = Drafts(vec![draft.clone()]);
    let dirs = FILES.iter().filter_map(|file| draft.join(file).parent().map(fs::create_dir_all));
    dirs.collect::<io::Result<()>>().map_err(failed)?;
    let mut set = DataSet {
        data: ParquetFile::create(&draft.join(FILES[0]), &LAYOUT.frames).map_err(failed)?,
        episodes: ParquetFile::create(&draft.join(FILES[1]), &LAYOUT.episodes).map_err(failed)?,
        shape: None,
        numbers: vec![Vec::new(); LAYOUT.frames.columns.len()],
        info: LAYOUT.info.clone(),
        count: 0,
        frames: 0,
    };
    for (index, run) in runs.iter().enumerate() {
        show(index as f64 / runs.len() as f64, run);
        let episode = Episode::read(run)?;
        let shape = set.shape.get_or_insert(episode.shape.clone());
        if episode.shape != *shape {
            let (run, first, found) = (run.display(), runs[0].display(), &episode.shape);
            return Err(Failure::bad_input(format!("{run}: expected {shape}, as in {first}, found {found}")));
        }
        set.add(episode, run, &draft).map_err(failed)?;
    }
    let frames = set.finish(&draft).map_err(failed)?;
    // an empty folder may have the name
    fs::remove_dir(folder).ok();
    fs::rename(&draft, folder).map_err(failed)?;
    Ok(frames as u64)
}

/// A data set that is being written.
struct DataSet {
    data: ParquetFile,
    episodes: ParquetFile,
    /// Shape of all runs, which is their task.
    shape: Option<String>,
    /// Numbers in the frames, by column, frame, and place in a list.
    numbers: Vec<Vec<Vec<f64>>>,
    info: Value,
    count: usize,
    frames: usize,
}

impl DataSet {
    fn add(&mut self, episode: Episode, run: &Path, folder: &Path) -> io::Result<()> {
        let (first, length, job) = (self.frames, episode.frames.len(), &episode.provenance["job"]);
        if self.count == 0 {
            // frames follow one another at uneven times: this is their mean rate
            let ended_s = episode.frames.last().and_then(|frame| frame["ended_at_s"].as_f64()).unwrap_or(1.0);
            self.info["fps"] = ((length as f64 / ended_s).round().max(1.0) as u64).into();
            self.info["robot_type"] = job["rig"]["name"].clone();
        }
        let fps = self.info["fps"].as_f64().unwrap_or(1.0);
        for (index, mut frame) in episode.frames.into_iter().enumerate() {
            // LeRobot takes times for multiples of 1 / fps: `plate_time_s` has the true one
            frame["timestamp"] = ((index as f64 / fps) as f32).into();
            let indices = [("frame", index), ("episode", self.count), ("index", self.frames), ("zero", 0)];
            indices.into_iter().for_each(|(key, index)| frame[key] = index.into());
            let rows = LAYOUT.frames.rows(&frame).map_err(io::Error::other)?;
            for (value, of) in rows.iter().flatten().zip(&mut self.numbers) {
                of.push(numbers(value));
                if of.first().map(Vec::len) != of.last().map(Vec::len) {
                    return Err(io::Error::other(format!("lists of several lengths in {}", run.display())));
                }
            }
            self.data.rows(rows);
            self.frames += 1;
        }
        self.data.end_group()?;
        let row = json!({
            "episode": self.count, "tasks": [self.shape], "length": length, "from": first, "to": self.frames, "zero": 0,
            "stats": self.statistics(first), "provenance": episode.provenance, "job": job.to_string(),
        });
        self.episodes.rows(LAYOUT.episodes.rows(&row).map_err(io::Error::other)?);
        self.episodes.end_group()?;
        let kept = folder.join(RUNS).join(format!("episode-{:06}", self.count));
        fs::create_dir_all(&kept)?;
        self.count += 1;
        KEPT.iter().try_for_each(|name| fs::copy(run.join(name), kept.join(name)).map(drop))
    }

    /// Statistics of each column from the frame `first` on, by which learners normalise.
    fn statistics(&self, first: usize) -> Value {
        let of_column = |(Column(name, ..), frames): (&Column, &Vec<Vec<f64>>)| {
            let place = |place: usize| frames[first..].iter().map(|frame| frame[place]).collect::<Vec<f64>>();
            let places: Vec<Vec<f64>> = (0..frames.first().map_or(0, Vec::len)).map(place).collect();
            let each = |of: fn(&[f64]) -> f64| places.iter().map(|numbers| of(numbers)).collect::<Value>();
            let min = each(|numbers| numbers.iter().copied().fold(f64::INFINITY, f64::min));
            let max = each(|numbers| numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max));
            let count = [self.frames - first];
            (name.clone(), json!({ "min": min, "max": max, "mean": each(mean), "std": each(std), "count": count }))
        };
        LAYOUT.frames.columns.iter().zip(&self.numbers).map(of_column).collect::<Map<_, _>>().into()
    }

    /// Writes the files about all episodes; the number of frames.
    fn finish(mut self, folder: &Path) -> io::Result<usize> {
        for (Column(name, ..), frames) in LAYOUT.frames.columns.iter().zip(&self.numbers) {
            let (feature, length) = (&mut self.info["features"][name], frames.first().map_or(0, Vec::len));
            feature["shape"] = json!([length]);
            if let Some(of) = feature["names"].as_array().cloned() {
                let name = |i: usize| Some(of[i % of.len()].as_str()?.replace('#', &(i / of.len() + 1).to_string()));
                feature["names"] = (0..length).map(name).collect();
            }
        }
        self.info["splits"] = json!({ "train": format!("0:{}", self.count) });
        (self.info["total_episodes"], self.info["total_frames"]) = (self.count.into(), self.frames.into());
        fs::write(folder.join(FILES[3]), format!("{:#}\n", self.info))?;
        fs::write(folder.join(FILES[4]), format!("{:#}\n", self.statistics(0)))?;
        let mut tasks = ParquetFile::create(&folder.join(FILES[2]), &LAYOUT.tasks)?;
        tasks.note("pandas", LAYOUT.pandas.to_string());
        tasks.rows([vec![0.into(), json!(self.shape)]]);
        [tasks, self.episodes, self.data].iter_mut().try_for_each(ParquetFile::finish)?;
        Ok(self.frames)
    }
}

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

fn std(numbers: &[f64]) -> f64 {
    let mean = mean(numbers);
    (numbers.iter().map(|number| (number - mean) * (number - mean)).sum::<f64>() / numbers.len() as f64).sqrt()
}

/// A run with its frames.
struct Episode {
    /// Equal for runs that fit into one data set.
    shape: String,
    provenance: Value,
    /// The journal's cycles, each with the `drive` of the pulse before it, `reward`, `done` and `success`.
    frames: Vec<Value>,
}

impl Episode {
    fn read(run: &Path) -> Result<Self, Failure> {
        let refusal = |text: &str| Failure::bad_input(format!("{}: expected {text}", run.display()));
        let report = report_of(run)?.ok_or_else(|| refusal("a run that ended, found no report.json"))?;
        let (mut frames, mut drive) = (Vec::new(), json!([0.0, 0.0, 0.0, 0.0]));
        read_lines(run, |line| {
            if line.kind == "cycle" {
                let mut frame = line.content;
                frame["reward"] = (reward(&frame) as f32).into();
                (frame["done"], frame["success"]) = (false.into(), false.into());
                let last = frame["sent"].as_array().and_then(|sent| sent.last()?["counts"].as_array());
                let next = last.map_or(drive.clone(), |motors| motors.iter().map(rms).collect());
                frame["drive"] = mem::replace(&mut drive, next);
                frames.push(frame);
            }
            Ok(())
        })?;
        let last = frames.last_mut().ok_or_else(|| refusal("one cycle or more, found none"))?;
        (last["done"], last["success"]) = (true.into(), report.reached_goal().into());
        let provenance = provenance(run)?;
        let job = &provenance["job"];
        let tasks = slice::from_ref(&job["task"]).iter().chain(job["tasks"].as_array().into_iter().flatten());
        let tasks: Vec<&str> = tasks.filter_map(|task| task["type"].as_str()).collect();
        let shape = format!("{} of {} parts", tasks.join(", "), report.parts.len());
        Ok(Self { shape, provenance, frames })
    }
}

/// Mean distance of the parts from their targets after a cycle, mm, negative.
fn reward(cycle: &Value) -> f64 {
    let (result, targets) = (numbers(&cycle["result_mm"]), numbers(&cycle["wanted"]["targets_mm"]));
    let off = result.chunks(2).zip(targets.chunks(2)).map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)));
    -off.map(|squares| squares.sum::<f64>().sqrt()).sum::<f64>() / (result.len() / 2).max(1) as f64
}

/// Root mean square of a motor's counts, given as cosine and sine of each harmonic.
fn rms(motor: &Value) -> f32 {
    (numbers(motor).iter().map(|count| count * count).sum::<f64>() / 2.0).sqrt() as f32
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::sync::Arc;

    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::{List, ListAccessor, Row, RowAccessor};
    use tempfile::TempDir;

    use super::*;

    /// Runs a command of words, `@` for the folder; its document, or its refusal with the same `@`.
    fn upm(words: &str, folder: &TempDir) -> Result<Value, String> {
        let (root, folder) = (env!("CARGO_MANIFEST_DIR"), folder.path().to_str().unwrap());
        let words = words.split(' ').map(|word| word.replace('@', folder).replace('~', root).into());
        let told = crate::cli::answer(["upm".into()].into_iter().chain(words), &Arc::default());
        told.map(|text| serde_json::from_str(&text).unwrap()).map_err(|lines| lines.join("\n").replace(folder, "@"))
    }

    /// Rows of a file, and its number of row groups.
    fn read(path: &Path) -> (Vec<Row>, usize) {
        let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
        (reader.get_row_iter(None).unwrap().map(Result::unwrap).collect(), reader.metadata().num_row_groups())
    }

    #[test]
    fn data_set_has_the_cycles_of_its_runs_and_shows_what_was_changed() {
        let out = TempDir::new().unwrap();
        let at = |file: &str| out.path().join(file);
        for (name, seed) in [("a", 1), ("b", 2)] {
            let options = format!("--seed {seed} --camera positions --rerun off --out @/out");
            upm(&format!("run ~/configs/arrange-2.json {options}"), &out).unwrap();
            fs::rename(&folders_in(&at("out"))[0], at(name)).unwrap();
        }
        upm("export @/a @/b --lerobot @/set --mcap @/log.mcap", &out).unwrap();
        let [(frames, groups), (episodes, lines)] = [0, 1].map(|file| read(&at("set").join(FILES[file])));
        assert_eq!((groups, lines), (2, 2));
        let mut rows = frames.iter();
        for (run, facts) in ["a", "b"].iter().zip(&episodes) {
            let journal = fs::read_to_string(at(run).join("journal.jsonl")).unwrap();
            let lines = journal.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
            let cycles: Vec<Value> = lines.filter(|line| line["type"] == "cycle").collect();
            let (episode, length) = (facts.get_long(0).unwrap(), cycles.len() as i64);
            assert_eq!((facts.get_long(9).unwrap(), facts.get_long(2).unwrap()), (episode + 1, length), "seed, length");
            for (index, cycle) in (0..).zip(&cycles) {
                let row = rows.next().unwrap();
                let read = |of: &List| (0..of.len()).map(|i| of.get_float(i).unwrap()).collect::<Vec<f32>>();
                let single = |of: &Value| numbers(of).into_iter().map(|number| number as f32).collect::<Vec<f32>>();
                assert_eq!(read(row.get_list(0).unwrap()), single(&cycle["observed_mm"]));
                assert_eq!(read(row.get_list(3).unwrap()), single(&cycle["wanted"]["subgoals_mm"]), "action");
                assert_eq!([5, 6].map(|of| row.get_bool(of).unwrap()), [index + 1 == length; 2], "done, success");
                assert_eq!([9, 10].map(|of| row.get_long(of).unwrap()), [index, episode]);
            }
        }
        assert!(rows.next().is_none());
        let log = fs::read(at("log.mcap")).unwrap();
        let stats = mcap::Summary::read(&log).unwrap().unwrap().stats.unwrap();
        assert_eq!((stats.channel_count, stats.metadata_count, stats.schema_count), (8, 2, 4));
        assert!(mcap::Summary::read(&log[..log.len() / 2]).is_err(), "a file that was cut is no log");

        assert_eq!(upm("verify @/set", &out).unwrap()["equal"], true);
        let [data, journal] = [FILES[0], "meta/upm/episode-000001/journal.jsonl"].map(|of| at("set").join(of));
        fs::write(&data, "other frames").unwrap();
        fs::write(&journal, fs::read_to_string(&journal).unwrap().replacen("solved", "solvent", 1)).unwrap();
        let told = upm("verify @/set", &out).unwrap();
        assert_eq!([0, 1].map(|episode| told["episodes"][episode]["equal"] == true), [true, false]);
        assert_eq!(told["files_that_differ"][0], data.to_str().unwrap());

        let text = fs::read_to_string(at("b/effective.json")).unwrap();
        fs::write(at("b/effective.json"), text.replace("\"arrange\"", "\"sort\"")).unwrap();
        let other = "upm: @/b: expected arrange of 2 parts, as in @/a, found sort of 2 parts";
        assert_eq!(upm("export @/a @/b --lerobot @/new", &out).unwrap_err(), other);
        let full = "upm: --lerobot: expected a new or an empty folder, found @/set";
        assert_eq!(upm("export @/a --lerobot @/set", &out).unwrap_err(), full);
        fs::remove_file(at("b/report.json")).unwrap();
        let killed = "upm: @/b: expected a run that ended, found no report.json";
        assert_eq!(upm("export @/b --lerobot @/new", &out).unwrap_err(), killed);
        assert!(!at("new").exists() && !at("new.part").exists());
    }
}
