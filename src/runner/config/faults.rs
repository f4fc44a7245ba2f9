//! Simulated faults of a job: written in its file, or typed on the command line.

use upm_core::document::{Diagnostics, Path, counted, one_of, quoted};
use upm_core::time::PlateTime;
use upm_recording::{FaultEntry, FaultValue};
use upm_sim::faults::{FaultKind, FaultSpec, FaultyComponent, ValueRange};

/// Names of components for error messages.
const COMPONENTS: [&str; 11] =
    ["camera", "light", "view", "coil0", "coils", "accel0", "part0", "parts", "plate", "device", "clock"];
/// Latest onset and end, s.
const LATEST_S: f64 = 1e6;

/// Most faults of a job.
pub(super) const MOST_FAULTS: usize = 32;

/// `spec` in the form of a job file.
pub(crate) fn fault_entry(spec: &FaultSpec) -> FaultEntry {
    let count = spec.kind.values().len();
    let value = match count {
        0 => None,
        1 => Some(FaultValue::One(spec.values[0])),
        _ => Some(FaultValue::Several(spec.values.iter().copied().take(count).collect())),
    };
    let (component, kind) = (spec.component.name(), spec.kind.code().to_owned());
    FaultEntry { component, kind, value, from_s: spec.from.secs(), to_s: spec.to.map(PlateTime::secs) }
}

/// Reads `COMPONENT:KIND[=VALUE[;VALUE]][@FROM_S[-TO_S]]`; `None` where `text` has another form.
fn parsed(text: &str) -> Option<FaultEntry> {
    let (what, when) = cut(text, '@');
    let (what, value) = cut(what, '=');
    let (component, kind) = what.split_once(':')?;
    let numbers = |list: &str| list.split(';').map(|n| n.trim().parse()).collect::<Result<Vec<f64>, _>>();
    let (from_s, to_s) = cut(when.unwrap_or("0"), '-');
    Some(FaultEntry {
        component: component.trim().to_owned(),
        kind: kind.trim().to_owned(),
        value: value.map(numbers).transpose().ok()?.map(FaultValue::Several),
        from_s: from_s.parse().ok()?,
        to_s: to_s.map(str::parse).transpose().ok()?,
    })
}

/// `text` before the first `at`, and what follows it.
fn cut(text: &str, at: char) -> (&str, Option<&str>) {
    text.split_once(at).map_or((text, None), |(before, after)| (before, Some(after)))
}

/// Simulated faults of a job whose parts have these names.
pub(super) fn build(list: &[FaultEntry], ids: &[String], at: &Path, faults: &mut Diagnostics) -> Vec<FaultSpec> {
    list.iter().enumerate().filter_map(|(i, entry)| spec(entry, ids, &at.index(i), faults)).collect()
}

/// Simulated faults in `texts`, each one or several separated by commas, for a job whose parts have these names.
pub(super) fn typed(texts: &[String], ids: &[String], faults: &mut Diagnostics) -> Vec<FaultSpec> {
    let each = texts.iter().flat_map(|text| text.split(',')).map(str::trim).filter(|text| !text.is_empty());
    let mut specs = Vec::new();
    for text in each {
        let at = Path::root().key(text);
        match parsed(text) {
            Some(entry) => specs.extend(spec(&entry, ids, &at, faults)),
            None => {
                let allowed = "COMPONENT:KIND[=VALUE[;VALUE]][@FROM_S[-TO_S]], for example coil0:reversed@1.2";
                faults.push(Path::root(), quoted(text), allowed);
            }
        }
    }
    specs
}

/// Allowed component names, for an error about the name `found` in a job whose parts have these names.
fn components(found: &str, ids: &[String]) -> String {
    let has_number = |class: &&str| found.strip_prefix(*class).is_some_and(|rest| rest.parse::<u32>().is_ok());
    match ["coil", "accel"].into_iter().find(has_number) {
        Some(class) => format!("{class}0 to {class}3"),
        None => one_of(found, &COMPONENTS.into_iter().chain(ids.iter().map(String::as_str)).collect::<Vec<_>>()),
    }
}

fn spec(entry: &FaultEntry, ids: &[String], at: &Path, faults: &mut Diagnostics) -> Option<FaultSpec> {
    let parts = ids.len();
    let named = || ids.iter().position(|id| *id == entry.component).map(FaultyComponent::Part);
    let Some(component) = FaultyComponent::named(&entry.component).or_else(named) else {
        let found = quoted(&entry.component);
        faults.push(at.key("component"), found, components(&entry.component, ids));
        return None;
    };
    if let FaultyComponent::Part(part) = component {
        let allowed = format!("part0 to part{}", parts.saturating_sub(1));
        faults.require(part < parts, at.key("component"), &entry.component, allowed);
    }
    let Some(kind) = component.kinds().find(|kind| kind.code() == entry.kind) else {
        let kinds: Vec<&str> = component.kinds().map(FaultKind::code).collect();
        faults.push(at.key("kind"), quoted(&entry.kind), one_of(&entry.kind, &kinds));
        return None;
    };
    let (given, wanted) = (entry.value.as_ref().map_or(&[][..], FaultValue::numbers), kind.values());
    let at_value = at.key("value");
    if given.len() != wanted.len() {
        let found = format!("{} for {}", counted(given.len(), "value"), kind.code());
        faults.push(at_value, found, text_of_ranges(wanted));
        return None;
    }
    let mut values = [0.0; 3];
    for (i, (value, range)) in given.iter().zip(wanted).enumerate() {
        let top = match (kind, component) {
            (FaultKind::Swapped, FaultyComponent::Coils) => 3.0,
            (FaultKind::Swapped, _) => parts.saturating_sub(1) as f64,
            _ => range.max,
        };
        let fits = (range.min..=top).contains(value) && (!range.whole || value.fract() == 0.0);
        let allowed = format!("{}{} to {top} ({})", if range.whole { "whole, " } else { "" }, range.min, range.name);
        faults.require(fits, at_value.index(i), value, allowed);
        values[i] = *value;
    }
    if kind == FaultKind::Swapped {
        let found = format!("{} and {}", values[0], values[1]);
        faults.require(values[0] != values[1], &at_value, found, "two different ones");
    }
    let in_time = |s: f64| (0.0..=LATEST_S).contains(&s);
    faults.require(in_time(entry.from_s), at.key("from_s"), entry.from_s, format!("0 to {LATEST_S}"));
    if let Some(to_s) = entry.to_s {
        let allowed = format!("a time after from_s, {}, up to {LATEST_S}", entry.from_s);
        let is_later = PlateTime::from_secs(to_s) > PlateTime::from_secs(entry.from_s);
        faults.require(in_time(to_s) && is_later, at.key("to_s"), to_s, allowed);
    }
    let (from, to) = (PlateTime::from_secs(entry.from_s), entry.to_s.map(PlateTime::from_secs));
    Some(FaultSpec { component, kind, values, from, to })
}

fn text_of_ranges(ranges: &[ValueRange]) -> String {
    let text = |range: &ValueRange| format!("{} to {} ({})", range.min, range.max, range.name);
    let each: Vec<String> = ranges.iter().map(text).collect();
    if each.is_empty() { "no value".to_owned() } else { each.join("; ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> Vec<String> {
        ["penny-1", "penny-2", "left.one"].map(str::to_owned).to_vec()
    }

    fn read(text: &str) -> Result<Vec<FaultSpec>, Vec<String>> {
        let mut faults = Diagnostics::of("--faults");
        let specs = typed(&[text.to_owned()], &names(), &mut faults);
        faults.into_result(Some(specs)).map_err(|list| list.iter().map(ToString::to_string).collect())
    }

    #[test]
    fn typed_faults_are_read_with_values_and_times() {
        let specs = read("coil0:reversed@1.2, camera:shift=3;-1.5@0.5-1.5,device:hang=1").unwrap();
        let [coil, shift, hang] = &specs[..] else { panic!("{specs:?}") };
        assert_eq!((coil.component, coil.kind), (FaultyComponent::Coil(0), FaultKind::Reversed));
        assert_eq!((coil.from, coil.to), (PlateTime::from_secs(1.2), None));
        assert_eq!((shift.values, shift.to), ([3.0, -1.5, 0.0], Some(PlateTime::from_secs(1.5))));
        assert_eq!(hang.values[0], 1.0);
        for name in ["left.one:glued@1", "part2:glued@1"] {
            assert_eq!(read(name).unwrap()[0].component, FaultyComponent::Part(2));
        }
    }

    #[test]
    fn wrong_faults_are_refused_with_the_expected_values() {
        for (text, said) in [
            ("coil0", "COMPONENT:KIND"),
            ("camera:freeze@x", "COMPONENT:KIND"),
            ("coil7:dead", "coil0 to coil3"),
            ("coill:dead", "did you mean coil0"),
            ("part3:glued", "part0 to part2"),
            ("penny-3:glued", "clock, penny-1, penny-2, left.one (did you mean penny-1?)"),
            ("camera:freez", "did you mean freeze"),
            ("camera:flip", "freeze, late, drop"),
            ("camera:shift=1", "-2000 to 2000 (px); -2000 to 2000 (px)"),
            ("camera:freeze=1", "no value"),
            ("camera:drop=2", "0 to 1 (a share)"),
            ("camera:late=1.5", "whole, 0 to 60"),
            ("camera:freeze@2-1", "a time after from_s, 2"),
            ("coils:swapped=0;4", "whole, 0 to 3"),
            ("parts:swapped=1;1", "two different ones"),
            ("camera:drop=NaN", "0 to 1"),
        ] {
            let lines = read(text).unwrap_err();
            assert!(lines.len() == 1 && lines[0].contains(said), "{text}: {lines:?}");
        }
    }
}
