//! Import cycles among the files of one crate. A re-export (`pub use`) is not an import, and a re-exported name counts
//! for the file that defines it.

use std::collections::{BTreeMap, BTreeSet};

use super::map::member_of;
use super::scan::{Scan, Written};

/// Most re-exports followed for one name.
const DEEPEST: usize = 12;

/// The modules of one crate: file and scan of each.
struct Crate<'a> {
    modules: BTreeMap<Vec<String>, (&'a str, &'a Scan)>,
}

/// Imports of each file: the other file, and one name imported from it.
type Imports<'a> = BTreeMap<&'a str, BTreeMap<&'a str, String>>;

/// Crate and module path of a file: `src/core/job/pace.rs` is `job::pace` of the crate in `src/core`, and
/// `src/upm/cli/args.rs` is `cli::args` of the root.
fn module_of(file: &str) -> Option<(&str, Vec<String>)> {
    let of = member_of(file).unwrap_or("upm");
    let inside = file.strip_prefix("src/")?.strip_prefix(of)?.strip_suffix(".rs")?;
    let path = inside.split('/').filter(|part| !["", "lib", "main", "mod"].contains(part));
    Some((of, path.map(str::to_owned).collect()))
}

impl<'a> Crate<'a> {
    fn child(&self, module: &[String], name: &str) -> Option<Vec<String>> {
        let child: Vec<String> = module.iter().cloned().chain([name.to_owned()]).collect();
        self.modules.contains_key(&child).then_some(child)
    }

    /// Absolute form of `path`, written in `module`, from the crate's root; `None` if it leaves the crate.
    fn path_from_root(&self, module: &[String], inline: usize, path: &[String]) -> Option<Vec<String>> {
        let climbs = path.iter().take_while(|segment| *segment == "super").count();
        let rest = |start: &[String], skipped: usize| Some([start, &path[skipped..]].concat());
        match path.first()?.as_str() {
            "crate" => rest(&[], 1),
            "super" => rest(&module[..module.len().checked_sub(climbs.saturating_sub(inline))?], climbs),
            "self" => rest(module, 1),
            first if self.child(module, first).is_some() => rest(module, 0),
            _ => None,
        }
    }

    /// The `use` in `module` that binds `name`.
    fn bound(&self, module: &[String], name: &str) -> Option<&'a Written> {
        let (_, scan) = self.modules.get(module)?;
        let uses = scan.mentions.iter().filter(|mention| !mention.in_test).map(|mention| &mention.written);
        uses.filter(|written| written.bound.as_deref() == Some(name)).find(|written| written.path.len() > 1)
    }

    /// Module of a glob import in `module` that defines `name`.
    fn by_glob(&self, module: &[String], name: &str) -> Option<Vec<String>> {
        let (_, scan) = self.modules.get(module)?;
        let globs = scan.mentions.iter().filter(|mention| !mention.in_test).map(|mention| &mention.written);
        globs.filter(|written| written.bound.as_deref() == Some("*")).find_map(|written| {
            let of = self.path_from_root(module, written.inline, &written.path[..written.path.len() - 1])?;
            self.modules.get(&of)?.1.defined.iter().any(|defined| defined == name).then_some(of)
        })
    }

    /// File that defines the item at `path`, from the crate's root.
    fn file_of(&self, path: &[String], depth: usize) -> Option<&'a str> {
        let mut module: Vec<String> = Vec::new();
        for (k, segment) in path.iter().enumerate() {
            if let Some(child) = self.child(&module, segment) {
                module = child;
                continue;
            }
            let defines = self.modules.get(&module).is_some_and(|(_, scan)| scan.defined.contains(segment));
            let target = match self.bound(&module, segment).filter(|_| !defines && depth < DEEPEST) {
                Some(written) => Some(self.absolute(&module, written)?),
                None => self.by_glob(&module, segment).map(|of| [&of[..], std::slice::from_ref(segment)].concat()),
            };
            return match target {
                Some(target) => self.file_of(&[&target[..], &path[k + 1..]].concat(), depth + 1),
                None => self.modules.get(&module).map(|(file, _)| *file),
            };
        }
        self.modules.get(&module).map(|(file, _)| *file)
    }

    /// Absolute path of a path in `module`, with names bound by a `use` resolved.
    fn absolute(&self, module: &[String], written: &Written) -> Option<Vec<String>> {
        if let Some(path) = self.path_from_root(module, written.inline, &written.path) {
            return Some(path);
        }
        let first = written.path.first().filter(|_| written.bound.is_none())?;
        let by_use = self.bound(module, first)?;
        let start = self.path_from_root(module, by_use.inline, &by_use.path)?;
        Some([&start[..], &written.path[1..]].concat())
    }

    fn imports(&self) -> Imports<'a> {
        let mut imports = Imports::new();
        for (module, (file, scan)) in &self.modules {
            for mention in scan.mentions.iter().filter(|mention| !mention.in_test && !mention.written.is_handed_on) {
                let path = self.absolute(module, &mention.written);
                if let Some(other) = path.and_then(|path| self.file_of(&path, 0)).filter(|other| other != file) {
                    let name = mention.written.path.last().cloned().unwrap_or_default();
                    imports.entry(file).or_default().entry(other).or_insert(name);
                }
            }
        }
        imports
    }
}

/// All files that `from` reaches by imports.
fn reached<'a>(imports: &Imports<'a>, from: &'a str) -> BTreeSet<&'a str> {
    let (mut reached, mut queue) = (BTreeSet::new(), vec![from]);
    while let Some(file) = queue.pop() {
        for &next in imports.get(file).into_iter().flat_map(BTreeMap::keys) {
            if reached.insert(next) {
                queue.push(next);
            }
        }
    }
    reached
}

/// All import cycles among `files` (path and scan; tests left out), each as its imports: `a.rs -> b.rs: Name`.
pub fn cycles(files: &[(&str, &Scan)]) -> Vec<String> {
    let mut crates: BTreeMap<&str, Crate> = BTreeMap::new();
    for &(file, scan) in files {
        if let Some((of, module)) = module_of(file) {
            let modules = &mut crates.entry(of).or_insert(Crate { modules: BTreeMap::new() }).modules;
            modules.insert(module, (file, scan));
        }
    }
    let mut found = Vec::new();
    for of in crates.values() {
        let imports = of.imports();
        let reach: BTreeMap<&str, BTreeSet<&str>> =
            imports.keys().map(|&file| (file, reached(&imports, file))).collect();
        let in_one = |a: &str, b: &str| reach.get(a).is_some_and(|r| r.contains(b)) && reach[b].contains(a);
        let mut seen: BTreeSet<&str> = BTreeSet::new();
        for &first in imports.keys().filter(|&&file| in_one(file, file)) {
            if seen.contains(first) {
                continue;
            }
            let cycle: Vec<&str> = imports.keys().copied().filter(|&file| in_one(first, file)).collect();
            seen.extend(&cycle);
            let arrows = cycle.iter().flat_map(|&from| imports[from].iter().map(move |(to, name)| (from, to, name)));
            let inside = arrows.filter(|(_, to, _)| cycle.contains(*to));
            let lines: Vec<String> = inside.map(|(from, to, name)| format!("  {from} -> {to}: {name}")).collect();
            found.push(format!("import cycle of {} files:\n{}", cycle.len(), lines.join("\n")));
        }
    }
    found
}
