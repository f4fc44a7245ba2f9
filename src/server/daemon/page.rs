use std::fmt::Write as _;
use std::sync::OnceLock;

use bytes::Bytes;
use serde::Serialize;
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::api::Asset;

const HTML: &str = "text/html; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const PICTURE: &str = "image/svg+xml";
const JSON: &str = "application/json";

macro_rules! page {
    ($($media:ident $name:literal)*) => {
        &[$(($name, $media, include_str!(concat!("../../../assets/page/", $name)))),*]
    };
}

/// The files of the page, compiled in.
const FILES: &[(&str, &str, &str)] = page! {
    HTML "index.html"
    STYLE "style.css" STYLE "plates.css" STYLE "jobs.css" STYLE "pen.css"
    PICTURE "icon.svg"
    SCRIPT "age.js" SCRIPT "api.js" SCRIPT "app.js" SCRIPT "camera.js" SCRIPT "device.js" SCRIPT "dom.js"
    SCRIPT "drawn.js" SCRIPT "editor.js" SCRIPT "estop.js" SCRIPT "events.js" SCRIPT "jobs.js" SCRIPT "kinds.js"
    SCRIPT "left.js" SCRIPT "pen.js" SCRIPT "places.js" SCRIPT "plate.js" SCRIPT "reset.js"
    SCRIPT "submit.js" SCRIPT "view.js" SCRIPT "watch.js"
};

macro_rules! shipped {
    ($($name:literal)*) => { &[$(($name, include_str!(concat!("../../../configs/", $name, ".json")))),*] };
}

/// The jobs of `configs/`.
const JOBS: &[(&str, &str)] = shipped! {
    "arrange-2" "arrange-4" "arrange-4-cor" "arrange-8" "arrange-16" "arrange-24" "ballet-8" "bowtie-3"
    "circle-turns" "hold-4" "letters-16" "line-10" "plus-sign" "plus-sign-endless" "plus-sign-upm-2" "ring-6" "sort-8" "sort-8-fields" "sort-12"
    "sort-12-fields" "swap-2" "trajectories" "trajectories-cor"
};

/// The rigs of `configs/rigs/` that jobs name.
const RIGS: &[(&str, &str)] = shipped! { "rigs/upm-1" "rigs/upm-2" "rigs/upm-2-knocked" };

/// A file of the operator page; `index.html` is the page itself, `examples.json` the shipped jobs.
pub(super) fn asset(name: &str) -> Option<Asset> {
    static ASSETS: OnceLock<Vec<(&str, Asset)>> = OnceLock::new();
    let assets = ASSETS.get_or_init(|| {
        let files = FILES.iter().map(|(name, media, text)| (*name, of(media, Bytes::from_static(text.as_bytes()))));
        let examples = serde_json::to_vec(&examples()).unwrap_or_default();
        files.chain([("examples.json", of(JSON, examples.into()))]).collect()
    });
    assets.iter().find(|(known, _)| *known == name).map(|(_, asset)| asset.clone())
}

fn of(media: &'static str, bytes: Bytes) -> Asset {
    let mut etag = String::from("\"");
    for byte in Sha256::digest(&bytes).iter().take(16) {
        let _ = write!(etag, "{byte:02x}");
    }
    etag.push('"');
    Asset { media, bytes, etag }
}

/// A shipped job in the form in which clients submit it.
#[derive(Debug, Serialize)]
struct Example {
    name: &'static str,
    /// Task and number of parts, as text.
    what: String,
    /// Name of the rig that it was made for, which the rig's file states.
    rig: String,
    /// The file with its layout kept and without the members that name other files.
    text: String,
}

/// The shipped jobs, except those for a rig that is knocked: without the knocks they have nothing to do.
fn examples() -> Vec<Example> {
    let example = |(name, text): &(&'static str, &str)| {
        let job: Value = serde_json::from_str(text).ok()?;
        let rig = rig_of(&job)?;
        let is_knocked = rig.pointer("/simulation/knocks").is_some();
        let rig = rig.get("name")?.as_str()?.to_owned();
        (!is_knocked).then_some(Example { name, what: what(&job)?, rig, text: without_files(text) })
    };
    JOBS.iter().filter_map(example).collect()
}

/// The rig that a shipped job names.
fn rig_of(job: &Value) -> Option<Value> {
    let named = job.get("rig")?.as_str()?.strip_suffix(".json")?;
    let (_, text) = RIGS.iter().find(|(name, _)| *name == named)?;
    serde_json::from_str(text).ok()
}

fn what(job: &Value) -> Option<String> {
    let count = |part: &Value| part.get("count").map_or(Some(1), Value::as_u64);
    let parts: u64 = job.get("parts")?.as_array()?.iter().map(count).sum::<Option<u64>>()?;
    let task = job.get("task")?.get("type")?.as_str()?.replace('_', " ");
    let parts = format!("{task}, {parts} {}", if parts == 1 { "part" } else { "parts" });
    let planner = job.get("planner").and_then(Value::as_str);
    Some(planner.map_or(parts.clone(), |planner| format!("{parts}, {planner}")))
}

/// The text without the lines of `$schema`, `rig` and `library`: a submitted job names no files.
fn without_files(text: &str) -> String {
    let keys = ["$schema", "rig", "library"];
    let names_file = |line: &&str| keys.iter().any(|key| line.starts_with(&format!("  \"{key}\": \"")));
    text.split_inclusive('\n').filter(|line| !names_file(line)).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use upm_runner::config::{JobSpec, Origin, RigSpec};

    fn names_in(folder: &str) -> BTreeSet<String> {
        let files = std::fs::read_dir(std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(folder))
            .unwrap();
        let names = files.map(|file| file.unwrap()).filter(|file| file.path().is_file());
        names.map(|file| file.file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn every_file_of_the_page_is_served_and_no_other() {
        let listed: BTreeSet<String> = FILES.iter().map(|(name, ..)| (*name).to_owned()).collect();
        assert_eq!(listed, names_in("assets/page"));
        for (name, media, _) in FILES {
            let ending = name.rsplit('.').next().unwrap();
            let wanted = match ending {
                "html" => HTML,
                "css" => STYLE,
                "js" => SCRIPT,
                _ => PICTURE,
            };
            assert_eq!(*media, wanted, "{name}");
        }
        assert_eq!(asset("nothing.js"), None);
    }

    #[test]
    fn entity_tags_differ_with_the_content() {
        let names = FILES.iter().map(|(name, ..)| *name).chain(["examples.json"]);
        let tags: BTreeSet<String> = names.map(|name| asset(name).unwrap().etag).collect();
        assert_eq!(tags.len(), FILES.len() + 1);
        assert!(tags.iter().all(|tag| tag.len() == 34 && tag.starts_with('"') && tag.ends_with('"')));
    }

    #[test]
    fn files_of_the_page_name_only_files_of_the_page() {
        let of_a_script = |line: &'static str| line.split_once("from './")?.1.split_once('\'').map(|(name, _)| name);
        let of_a_page = |line: &'static str| line.split_once("\"/assets/")?.1.split_once('"').map(|(name, _)| name);
        for (name, _, text) in FILES {
            for named in text.lines().filter_map(|line| of_a_script(line).or_else(|| of_a_page(line))) {
                assert!(asset(named).is_some(), "{name} names {named}");
            }
            let addresses = text.matches("http").count();
            assert_eq!(addresses, text.matches("http://www.w3.org/2000/svg").count(), "{name} reaches outside");
        }
    }

    #[test]
    fn every_shipped_job_is_an_example_that_a_daemon_would_take() {
        let jobs = names_in("configs").into_iter().filter(|name| {
            let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join("configs").join(name);
            std::fs::read_to_string(path).unwrap().contains("\"task\"")
        });
        let listed: BTreeSet<String> = JOBS.iter().map(|(name, _)| format!("{name}.json")).collect();
        assert_eq!(jobs.collect::<BTreeSet<_>>(), listed);
        let examples = examples();
        let offered: BTreeSet<&str> = examples.iter().map(|example| example.name).collect();
        let not_offered: Vec<&str> =
            JOBS.iter().map(|(name, _)| *name).filter(|name| !offered.contains(name)).collect();
        assert_eq!(not_offered, ["hold-4"], "on a plate that is not knocked it has nothing to do");
        for example in examples {
            let rig = format!("configs/rigs/{}.json", example.rig);
            let rig =
                RigSpec::load(&std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(rig)).unwrap();
            let made = JobSpec::from_json(&example.text, &Origin::of_request("job"), Some(&rig));
            assert_eq!(made.err(), None, "{}", example.name);
        }
    }

    #[test]
    fn examples_are_summarized_by_task_parts_and_planner() {
        let examples = examples();
        let of = |name| examples.iter().find(|example| example.name == name).map(|example| example.what.as_str());
        assert_eq!(of("sort-12"), Some("sort, 12 parts, cor_sequence"));
        assert_eq!(of("plus-sign"), Some("plus sign, 1 part"));
        assert_eq!(of("sort-8-fields"), Some("sort, 8 parts, synthesized_field"));
    }
}
