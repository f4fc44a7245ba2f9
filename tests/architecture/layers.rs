//! Layers of the crates, computed from their manifests.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use super::map::MAP;

/// Imports of each crate of the workspace.
pub struct Crates(BTreeMap<&'static str, BTreeSet<&'static str>>);

/// Crates of the workspace, `upm` for the root package.
fn names() -> impl Iterator<Item = &'static str> {
    MAP.layers.iter().flat_map(|layer| &layer.crates).copied()
}

/// Dependencies of a crate within the workspace, in the sections of its manifest that `wanted` selects by name.
fn dependencies(of: &str, wanted: fn(&str) -> bool) -> BTreeSet<&'static str> {
    let folder = if of == "upm" { String::new() } else { format!("src/{of}/") };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder + "Cargo.toml");
    let manifest = fs::read_to_string(path).unwrap();
    let sections = manifest.split("\n[").filter_map(|section| section.split_once(']'));
    let lines = sections.filter(|(name, _)| wanted(name)).flat_map(|(_, section)| section.lines());
    let of_workspace = lines.filter_map(|line| line.split(['.', ' ', '=']).next()?.strip_prefix("upm"));
    let known = |name: String| names().find(|known| *known == name).unwrap_or_else(|| panic!("no `{name}` on the map"));
    of_workspace.map(|name| known(name.strip_prefix('-').unwrap_or("upm").replace('-', "_"))).collect()
}

impl Crates {
    /// Imports by the manifests, those of tests left out.
    pub fn read() -> Self {
        Self(names().map(|of| (of, dependencies(of, |section| section == "dependencies"))).collect())
    }

    /// Imports by the manifests, with those of tests.
    pub fn read_with_tests() -> Self {
        Self(names().map(|of| (of, dependencies(of, |section| section.ends_with("dependencies")))).collect())
    }

    /// Crates with their imports.
    pub fn imports(&self) -> impl Iterator<Item = (&'static str, &BTreeSet<&'static str>)> {
        self.0.iter().map(|(of, imports)| (*of, imports))
    }

    /// Length of the longest chain of imports below a crate.
    pub fn layer(&self, of: &str) -> usize {
        self.0[of].iter().map(|import| self.layer(import) + 1).max().unwrap_or(0)
    }

    /// All crates that a crate reaches by imports.
    pub fn reached(&self, from: &str) -> BTreeSet<&'static str> {
        let mut reached = BTreeSet::new();
        for import in &self.0[from] {
            reached.insert(*import);
            reached.extend(self.reached(import));
        }
        reached
    }
}
