//! The operator page: its files, compiled in, and the shipped jobs as examples.

use std::sync::LazyLock;

use axum::extract::{Path, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, IF_NONE_MATCH};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use bytes::Bytes;
use include_dir::{Dir, include_dir};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use super::extract::ApiState;
use crate::http::Problem;
use upm_core::document::counted;

static FILES: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../assets/page");
static CONFIGS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../configs");

pub(super) async fn index(state: ApiState, headers: HeaderMap) -> Result<Response, Problem> {
    asset(state, Path("index.html".to_owned()), headers).await
}

/// A file of the page, or the shipped jobs under the name `examples.json`. `no-cache` has browsers ask each time
/// whether it has changed.
pub(super) async fn asset(
    State(api): ApiState,
    Path(name): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let no_file = || Problem::new(StatusCode::NOT_FOUND, "the operator page has no such file");
    let content = content_of(&name).ok_or_else(no_file)?;
    let etag = format!("\"{:x}\"", Sha256::digest(&content));
    let headers_of_all = [
        (ETAG, etag.clone()),
        (CACHE_CONTROL, "no-cache".to_owned()),
        (CONTENT_SECURITY_POLICY, policy(api.spec.stop_listen.map(|address| address.port()))),
    ];
    if headers.get(IF_NONE_MATCH).is_some_and(|tag| tag.as_bytes() == etag.as_bytes()) {
        return Ok((headers_of_all, StatusCode::NOT_MODIFIED).into_response());
    }
    Ok((headers_of_all, [(CONTENT_TYPE, media_of(&name))], content).into_response())
}

/// Content security policy of the page: its own script, images it creates, calls to its own daemon and to the listener
/// for emergency stops.
fn policy(stop_port: Option<u16>) -> String {
    let stop = stop_port.map(|port| format!(" http://*:{port}")).unwrap_or_default();
    format!(
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'{stop}; \
         base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
}

fn content_of(name: &str) -> Option<Bytes> {
    static EXAMPLES: LazyLock<Bytes> = LazyLock::new(|| serde_json::to_vec(&examples()).unwrap_or_default().into());
    if name == "examples.json" {
        return Some(EXAMPLES.clone());
    }
    FILES.get_file(name).map(|file| Bytes::from_static(file.contents()))
}

fn media_of(name: &str) -> &'static str {
    match name.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("css") => "text/css; charset=utf-8",
        Some("js") => "text/javascript; charset=utf-8",
        Some("svg") => "image/svg+xml",
        _ => "application/json",
    }
}

/// The shipped jobs in the form in which clients submit them, except those for a rig that is knocked: without the
/// knocks they have nothing to do. `what` is the task and the number of parts, `rig` the name in the rig's file, and
/// `text` the file with its layout kept and without the members that name other files.
fn examples() -> Vec<Value> {
    let example = |file: &include_dir::File<'_>| {
        let text = file.contents_utf8()?;
        let job: Value = serde_json::from_str(text).ok()?;
        let rig: Value = serde_json::from_slice(CONFIGS.get_file(job.get("rig")?.as_str()?)?.contents()).ok()?;
        let is_knocked = rig.pointer("/simulation/knocks").is_some();
        let name = file.path().file_stem()?.to_str()?;
        let example = json!({"name": name, "what": what(&job)?, "rig": rig.get("name")?, "text": without_files(text)});
        (!is_knocked).then_some(example)
    };
    CONFIGS.files().filter_map(example).collect()
}

fn what(job: &Value) -> Option<String> {
    let count = |part: &Value| part.get("count").map_or(Some(1), Value::as_u64);
    let parts: u64 = job.get("parts")?.as_array()?.iter().map(count).sum::<Option<u64>>()?;
    let listed = job.get("tasks").and_then(Value::as_array).into_iter().flatten();
    let types = job.get("task").into_iter().chain(listed).filter_map(|task| task.get("type")?.as_str());
    let tasks = types.map(|name| name.replace('_', " ")).collect::<Vec<_>>().join(", ");
    let parts = format!("{tasks}, {}", counted(parts as usize, "part"));
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
    use super::*;
    use upm_runner::config::{JobSpec, Origin, RigSpec};

    #[test]
    fn files_of_the_page_name_only_files_of_the_page() {
        let of_a_script = |line: &'static str| line.split_once("from './")?.1.split_once('\'').map(|(name, _)| name);
        let of_a_page = |line: &'static str| line.split_once("\"assets/")?.1.split_once('"').map(|(name, _)| name);
        // a base path, or a proxy, is before them
        let absolute = ["'/readyz", "'/v1", "`/v1", "\"/assets", "\"/v1"];
        for file in FILES.files() {
            let (name, text) = (file.path().display(), file.contents_utf8().unwrap());
            assert!(absolute.iter().all(|address| !text.contains(address)), "{name}");
            for named in text.lines().filter_map(|line| of_a_script(line).or_else(|| of_a_page(line))) {
                assert!(content_of(named).is_some(), "{name} names {named}");
            }
            // the namespace of drawings, and the listener for emergency stops, whose host is not known here
            let outside =
                text.replace("http://www.w3.org/2000/svg", "").replace("`http://${", "").matches("http").count();
            assert_eq!(outside, 0, "{name} reaches outside");
        }
    }

    #[test]
    fn every_shipped_job_is_an_example_that_a_daemon_would_take() {
        let is_job = |file: &&include_dir::File<'_>| file.contents_utf8().unwrap().contains("\"task\"");
        let jobs = CONFIGS.files().filter(is_job).map(|file| file.path().file_stem().unwrap().to_str().unwrap());
        let examples = examples();
        let not_offered: Vec<&str> =
            jobs.filter(|name| !examples.iter().any(|example| example["name"] == *name)).collect();
        assert_eq!(not_offered, ["hold-4"], "on a plate that is not knocked it has nothing to do");
        for example in &examples {
            let rig = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/rigs");
            let rig = rig.join(example["rig"].as_str().unwrap());
            let rig = RigSpec::load(&rig.with_extension("json")).unwrap();
            let made = JobSpec::from_json(example["text"].as_str().unwrap(), &Origin::of_request("job"), Some(&rig));
            assert_eq!(made.err(), None, "{}", example["name"]);
        }
        let of = |name: &str| examples.iter().find(|example| example["name"] == name)?["what"].as_str();
        assert_eq!(of("sort-12"), Some("sort, 12 parts"));
        assert_eq!(of("plus-sign"), Some("plus sign, 1 part"));
        assert_eq!(of("sort-8-fields"), Some("sort, 8 parts, synthesized_field"));
    }
}
