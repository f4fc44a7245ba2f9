//! Parts by name.

use super::job_file::PathEntry;
use super::kinds::{PartGroup, part_ids};
use super::read::{NAMES, is_name};
use super::rig::RigSpec;
use super::task::TaskContext;
use upm_core::document::{Diagnostics, Path, one_of, quoted};

/// Reports names that are not valid, that stand for several parts, or that two parts would have; `penny-2` is the name
/// of the second penny without one.
pub(super) fn check_names(groups: &[PartGroup], rig: &RigSpec, faults: &mut Diagnostics) {
    let before = faults.len();
    let at = |group: usize| Path::root().key("parts").index(group).key("name");
    for (i, PartGroup { count, name, .. }) in groups.iter().enumerate() {
        let Some(name) = name else { continue };
        faults.require(is_name(name), at(i), quoted(name), NAMES);
        faults.require(*count == 1, at(i), format!("{} for {count} parts", quoted(name)), "a name only with count 1");
    }
    if faults.len() > before {
        return;
    }
    let ids = part_ids(groups, &rig.kinds);
    let group_of: Vec<usize> = (0..).zip(groups).flat_map(|(i, group)| std::iter::repeat_n(i, group.count)).collect();
    for (part, id) in ids.iter().enumerate() {
        let Some(other) = ids.iter().take(part).position(|other| other == id) else { continue };
        let [earlier, later] = [other, part].map(|part| group_of[part]);
        let (named, other) = if groups[later].name.is_some() { (later, earlier) } else { (earlier, later) };
        let allowed = format!("a name of its own (parts[{other}] is {id}, too)");
        faults.push(at(named), format!("{} a second time", quoted(id)), allowed);
    }
}

impl TaskContext<'_> {
    /// Adds the parts with these names to `parts`. Faults: a name that no part has, a part that is there already.
    pub(super) fn add_named(&self, names: &[String], at: &Path, parts: &mut Vec<usize>, faults: &mut Diagnostics) {
        let ids: Vec<&str> = self.ids.iter().map(String::as_str).collect();
        for (i, name) in names.iter().enumerate() {
            match ids.iter().position(|id| id == name) {
                None => faults.push(at.index(i), quoted(name), one_of(name, &ids)),
                Some(part) if parts.contains(&part) => {
                    faults.push(at.index(i), format!("{} a second time", quoted(name)), "each part once");
                }
                Some(part) => parts.push(part),
            }
        }
    }

    /// Indices of the parts that the task names, of all where it names none. `None` if the file is at fault.
    pub(super) fn named(&self, names: Option<&[String]>, faults: &mut Diagnostics) -> Option<Vec<usize>> {
        let Some(names) = names else { return Some((0..self.ids.len()).collect()) };
        let (mut parts, before) = (Vec::new(), faults.len());
        self.add_named(names, &self.at.key("parts"), &mut parts, faults);
        (faults.len() == before).then_some(parts)
    }

    /// As [`Self::named`], of the parts on all paths, path by path.
    pub(super) fn named_on(&self, paths: &[PathEntry], faults: &mut Diagnostics) -> Option<Vec<usize>> {
        if paths.iter().all(|path| path.parts.is_none()) {
            return self.named(None, faults);
        }
        let (mut parts, before) = (Vec::new(), faults.len());
        for (i, path) in paths.iter().enumerate() {
            let at = self.at.key("paths").index(i);
            let Some(names) = &path.parts else {
                faults.push_missing(at.key("parts"), "the names of its parts, as on other paths");
                continue;
            };
            let is_one = path.count == 1 || path.count as usize == names.len();
            faults.require(is_one, at.key("count"), path.count, format!("{}, or nothing, beside parts", names.len()));
            self.add_named(names, &at.key("parts"), &mut parts, faults);
        }
        (faults.len() == before).then_some(parts)
    }

    /// The same with these parts alone, in this order.
    pub(super) fn with_parts(&self, parts: &[usize]) -> Self {
        Self {
            at: self.at.clone(),
            rig: self.rig,
            half_m: self.half_m,
            kinds: parts.iter().map(|&part| self.kinds[part]).collect(),
            radii_m: parts.iter().map(|&part| self.radii_m[part]).collect(),
            ids: parts.iter().map(|&part| self.ids[part].clone()).collect(),
        }
    }

    /// `asked` for each of the parts with these indices; nothing for the others.
    pub(super) fn of_each<T: Clone>(&self, parts: &[usize], asked: Vec<T>) -> Vec<Option<T>> {
        let mut each = vec![None; self.ids.len()];
        parts.iter().zip(asked).for_each(|(&part, asked)| each[part] = Some(asked));
        each
    }
}
