//! The rules of imports and of file sizes.

use std::collections::{BTreeMap, BTreeSet};

use super::cycles;
use super::map::{MAP, Room, below_src, member_of};
use super::scan::{Mention, Scan, scan};

/// Most lines of a source.
const LONGEST_FILE: usize = 400;

/// Rooms that neither control nor anything it imports may name, tests included.
const GROUND_TRUTH: [&str; 2] = ["sim", "ground_truth"];

/// A source file.
pub struct Source {
    /// Path from the project's root.
    file: String,
    lines: usize,
    scan: Scan,
    /// True for a module that is compiled for tests only.
    is_test: bool,
}

impl Source {
    /// Its crate, `upm` for the root package.
    pub fn member(&self) -> &str {
        member_of(&self.file).unwrap_or("upm")
    }

    /// Number of its lines with code outside tests.
    pub fn code_lines(&self) -> usize {
        if self.is_test { 0 } else { self.scan.code_lines.len() }
    }
}

/// A path in a room's source that leads to another room of the workspace or outside.
struct Import<'a> {
    room: &'a str,
    file: &'a str,
    mention: &'a Mention,
    /// Imported room and item in it; `None` for a path that leads outside.
    of: Option<(&'a str, Option<&'a str>)>,
    in_test: bool,
}

impl Import<'_> {
    /// The entry of the map that permits it.
    fn permission(&self, other: &str, item: Option<&str>) -> Option<&'static str> {
        let permits = |entry: &str| match entry.split_once("::") {
            None => entry == other,
            Some((of, wanted)) => {
                let fits = |item: &str| wanted.strip_prefix('*').map_or(item == wanted, |end| item.ends_with(end));
                of == other && item.is_some_and(fits)
            }
        };
        let listed = MAP.room(self.room).into_iter().flat_map(|room| &room.imports);
        MAP.base.iter().chain(listed).copied().find(|entry| permits(entry))
    }

    fn at(&self) -> String {
        format!("{}:{}", self.file, self.mention.line)
    }
}

/// Room of a source: `src/core/geometry/lens.rs` is in `geometry`, `src/sim/plate.rs` in `sim`; a crate's `lib.rs` that
/// only lists rooms is in none.
pub fn room_of(file: &str) -> Option<&str> {
    let path = below_src(file)?;
    let path = match member_of(file) {
        Some(of) if MAP.is_one_room(of) => return Some(of),
        Some(of) => path.strip_prefix(of)?.strip_prefix('/')?,
        None => path,
    };
    let room = path.split('/').next()?;
    let room = room.strip_suffix(".rs").unwrap_or(room);
    (room != "lib").then_some(room)
}

/// Depth of a file's module in its crate.
fn depth_of(file: &str) -> usize {
    let folders = file.matches('/').count() - usize::from(member_of(file).is_some() || file.starts_with("src/upm/"));
    if file.ends_with("/lib.rs") { 0 } else { folders }
}

/// Room, and item in it, of a path of this workspace as seen from `file`.
fn room_and_item<'a>(file: &'a str, segments: &'a [String]) -> Option<(&'a str, Option<&'a str>)> {
    let segment = |k: usize| segments.get(k).map(String::as_str);
    let of = match segment(0)? {
        "crate" => member_of(file).unwrap_or("upm"),
        "upm" => "upm",
        name => name.strip_prefix("upm_")?,
    };
    if MAP.is_one_room(of) { Some((of, segment(1))) } else { Some((segment(1)?, segment(2))) }
}

/// Sources from their paths and texts.
pub fn sources(files: &[(String, String)]) -> Vec<Source> {
    let scans: Vec<Scan> = files.iter().map(|(file, text)| scan(text, depth_of(file))).collect();
    let folder = |file: &str| file.trim_end_matches(".rs").trim_end_matches("/lib").trim_end_matches("/mod").to_owned();
    let tests = files.iter().zip(&scans).flat_map(|((file, _), scan)| {
        let folder = folder(file);
        scan.test_modules.iter().map(move |module| format!("{folder}/{module}"))
    });
    let tests: Vec<String> = tests.collect();
    let is_test = |file: &str| {
        tests.iter().any(|module| file.strip_prefix(module.as_str()).is_some_and(|rest| rest.starts_with(['.', '/'])))
    };
    let read = |((file, text), scan): (&(String, String), Scan)| Source {
        file: file.clone(),
        lines: text.lines().count(),
        scan,
        is_test: is_test(file),
    };
    files.iter().zip(scans).map(read).collect()
}

/// Imports of the sources whose room is on the map.
fn imports(sources: &[Source]) -> impl Iterator<Item = Import<'_>> {
    sources.iter().flat_map(|source| {
        let file = source.file.as_str();
        let room = room_of(file).filter(|room| MAP.room(room).is_some());
        room.into_iter().flat_map(move |room| {
            source.scan.mentions.iter().map(move |mention| {
                let in_test = mention.in_test || source.is_test;
                Import { room, file, mention, of: room_and_item(file, &mention.segments), in_test }
            })
        })
    })
}

/// Import cycles among the sources, tests left out.
pub fn cycles_in(sources: &[Source]) -> Vec<String> {
    let shipped = sources.iter().filter(|source| !source.is_test);
    let shipped: Vec<(&str, &Scan)> = shipped.map(|source| (source.file.as_str(), &source.scan)).collect();
    cycles::cycles(&shipped)
}

/// True for a mention of `name` itself or of an item in it.
fn names(mention: &Mention, name: &str) -> bool {
    let written = mention.segments.join("::") + "::";
    written.strip_prefix(name).is_some_and(|rest| rest.starts_with("::"))
}

/// True for a file at a place below `src/`: `core/files` is `src/core/files.rs` and all of `src/core/files/`.
fn is_at(file: &str, place: &str) -> bool {
    let rest = below_src(file).and_then(|path| path.strip_prefix(place));
    rest.is_some_and(|rest| rest.starts_with(['.', '/']))
}

/// All violations of the rules, as `file:line: rule`.
pub fn faults(sources: &[Source]) -> Vec<String> {
    let long = sources.iter().filter(|source| source.lines > LONGEST_FILE);
    let mut faults: Vec<String> = long
        .map(|source| format!("{}:{}: files have at most {LONGEST_FILE} lines", source.file, source.lines))
        .collect();
    let unknown = sources.iter().filter_map(|source| {
        let room = room_of(&source.file).filter(|room| MAP.room(room).is_none())?;
        Some(format!("{}:1: `{room}` is not on the map", source.file))
    });
    faults.extend(unknown);
    for import in imports(sources).filter(|import| !import.in_test) {
        match import.of {
            Some((other, item)) if other != import.room && import.permission(other, item).is_none() => {
                let path = std::iter::once(other).chain(item).collect::<Vec<_>>().join("::");
                faults.push(format!("{}: `{}` may not import `{path}`", import.at(), import.room));
            }
            Some(_) => {}
            None => faults.extend(MAP.outside.iter().filter_map(|(outside, places)| {
                let wrong = names(import.mention, outside) && !places.iter().any(|place| is_at(import.file, place));
                wrong.then(|| format!("{}: `{outside}` is named in {} only", import.at(), places.join(", ")))
            })),
        }
    }
    faults.extend(chains_to_ground_truth(sources));
    faults
}

/// Chains of imports by which control reaches the ground truth, tests included.
fn chains_to_ground_truth(sources: &[Source]) -> Vec<String> {
    let mut next: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for import in imports(sources).filter(|import| !import.in_test) {
        next.entry(import.room).or_default().extend(import.of.map(|(other, _)| other));
    }
    let (mut chains, mut queue) = (BTreeMap::from([("control", "control".to_owned())]), vec!["control"]);
    while let Some(room) = queue.pop() {
        for &other in next.get(room).into_iter().flatten().filter(|other| !GROUND_TRUTH.contains(other)) {
            let chain = format!("{} -> {other}", chains[room]);
            if chains.insert(other, chain).is_none() {
                queue.push(other);
            }
        }
    }
    let reached = imports(sources).filter_map(|import| {
        let (of, _) = import.of.filter(|(of, _)| GROUND_TRUTH.contains(of))?;
        Some(format!("{}: control reaches {of}: {} -> {of}", import.at(), chains.get(import.room)?))
    });
    reached.collect()
}

/// Entries of the map that no source outside tests needs: rooms without a file, imports, places of names from outside.
pub fn unused(sources: &[Source]) -> Vec<String> {
    let imports: Vec<Import> = imports(sources).filter(|import| !import.in_test).collect();
    let used = |room: &Room, entry: &str| {
        let of_room = imports.iter().filter(|import| import.room == room.name);
        of_room.filter_map(|import| import.permission(import.of?.0, import.of?.1)).any(|permission| permission == entry)
    };
    let empty = MAP.rooms.iter().filter(|room| !sources.iter().any(|source| room_of(&source.file) == Some(room.name)));
    let mut unused: Vec<String> = empty.map(|room| format!("`{}` has no source", room.name)).collect();
    for room in &MAP.rooms {
        let entries = room.imports.iter().filter(|entry| !used(room, entry));
        unused.extend(entries.map(|entry| format!("`{}` does not import `{entry}`", room.name)));
    }
    for (outside, places) in &MAP.outside {
        let is_named = |place: &str| {
            imports
                .iter()
                .any(|import| import.of.is_none() && names(import.mention, outside) && is_at(import.file, place))
        };
        let without = places.iter().filter(|place| !is_named(place));
        unused.extend(without.map(|place| format!("`{outside}` is not named in {place}")));
    }
    unused
}
