//! The map of the code in `ARCHITECTURE.md`: layers, rooms with their imports, and places of names from outside. The
//! page is the only place for them; the tests read them there.

use std::sync::LazyLock;

/// Text of `ARCHITECTURE.md`.
pub const PAGE: &str = include_str!("../../ARCHITECTURE.md");

/// The map on [`PAGE`].
pub static MAP: LazyLock<Map> = LazyLock::new(|| Map::read(PAGE));

/// Folders of the member crates below `src/`.
static MEMBERS: LazyLock<Vec<&str>> = LazyLock::new(|| {
    let lines = include_str!("../../Cargo.toml").lines();
    lines.filter_map(|line| line.trim().strip_prefix("\"src/")?.strip_suffix("\",")).collect()
});

/// Layers, rooms and places of the code.
#[derive(Debug, Default)]
pub struct Map {
    /// Layers from the bottom up.
    pub layers: Vec<Layer>,
    /// Rooms in the order of the page.
    pub rooms: Vec<Room>,
    /// Rooms that every room may import.
    pub base: Vec<&'static str>,
    /// Crates and modules from outside the workspace, each with the places below `src/` that alone may name it.
    pub outside: Vec<(&'static str, Vec<&'static str>)>,
}

/// Crates whose longest chains of imports are equally long.
#[derive(Debug)]
pub struct Layer {
    /// Number and purpose: `Layer 3: the control loop`.
    pub title: &'static str,
    /// Crates in the order of the page.
    pub crates: Vec<&'static str>,
}

/// A module at the top of a crate, or a crate that is not divided.
#[derive(Debug)]
pub struct Room {
    /// Its crate; `upm` for the root package.
    pub of: &'static str,
    /// Name of the module, or of the crate.
    pub name: &'static str,
    /// Permitted imports besides the base rooms: rooms, or items of one (`sim::*Params`: all that end so).
    pub imports: Vec<&'static str>,
}

/// Words of a line in code quotes.
pub fn quoted(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// Member crate of a file; `None` for the root package.
pub fn member_of(file: &str) -> Option<&str> {
    let (folder, _) = file.strip_prefix("src/")?.split_once('/')?;
    MEMBERS.contains(&folder).then_some(folder)
}

/// Path of a file below the folder of rooms: that of the root package is `src/upm/`.
pub fn below_src(file: &str) -> Option<&str> {
    file.strip_prefix("src/upm/").or_else(|| file.strip_prefix("src/"))
}

impl Map {
    fn read(page: &'static str) -> Self {
        let mut map = Self::default();
        // Last heading, and first line of the present paragraph or list item.
        let (mut heading, mut item) = ("", "");
        for line in page.lines() {
            let start = line.trim_start();
            if let Some(title) = line.strip_prefix("### ") {
                heading = title;
                map.layers.extend(title.starts_with("Layer ").then_some(Layer { title, crates: Vec::new() }));
            } else if line.starts_with("## ") {
                heading = "";
            }
            if item.is_empty() || start.is_empty() || start.starts_with("- ") {
                item = start;
            }
            if heading.starts_with("Layer ") {
                if line.starts_with("- `") {
                    map.add(quoted(line).next().unwrap_or_default());
                } else if item.starts_with("- Imports ") {
                    map.rooms.last_mut().into_iter().for_each(|room| room.imports.extend(quoted(line)));
                } else if item.starts_with("Base rooms") {
                    map.base.extend(quoted(line));
                }
            } else if let ("Names from outside", Some((names, places))) = (heading, line.rsplit_once(" | ")) {
                map.outside.extend(quoted(names).map(|name| (name, quoted(places).collect())));
            }
        }
        map
    }

    /// Adds the room at a path below `src/` (`core/rig`, `sim`, `cli`) and its crate to the last layer.
    fn add(&mut self, path: &'static str) {
        let root = if MEMBERS.contains(&path) { path } else { "upm" };
        let (of, name) = path.split_once('/').unwrap_or((root, path));
        self.rooms.push(Room { of, name, imports: Vec::new() });
        let layer = self.layers.last_mut().filter(|layer| !layer.crates.contains(&of));
        layer.into_iter().for_each(|layer| layer.crates.push(of));
    }

    /// Rooms of one name, which imports could not tell apart, and base rooms that are no rooms.
    pub fn faults(&self) -> Vec<String> {
        let is_earlier = |i: usize| self.rooms[..i].iter().any(|room| room.name == self.rooms[i].name);
        let twice = (0..self.rooms.len()).filter(|&i| is_earlier(i)).map(|i| &self.rooms[i]);
        let unknown = self.base.iter().filter(|name| self.room(name).is_none());
        let twice = twice.map(|room| format!("there is another room `{}` than that of `{}`", room.name, room.of));
        twice.chain(unknown.map(|name| format!("there is no base room `{name}`"))).collect()
    }

    /// The room with this name.
    pub fn room(&self, name: &str) -> Option<&Room> {
        self.rooms.iter().find(|room| room.name == name)
    }

    /// True if the crate is not divided into rooms.
    pub fn is_one_room(&self, of: &str) -> bool {
        self.room(of).is_some_and(|room| room.of == of)
    }
}
