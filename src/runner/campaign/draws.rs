//! Draws in a job: values in the place of which a run has one of several, or a random one.

use serde_json::{Map, Value, json};

use super::fault_draws::{self, FaultDraw};
use super::numbers::{index, log_within, within};
use upm_core::document::{Diagnostics, Path, counted, one_of, shown};
use upm_core::random::{Rng, Streams};

/// Names of draws.
const DRAWS: [&str; 8] = ["$each", "$faults", "$integer", "$log_uniform", "$one_of", "$places", "$plus", "$uniform"];
/// Attempts to find a place, for each place.
const TRIES: usize = 10_000;
/// Most parts of a job.
const MOST_PLACES: u64 = 64;

/// A value that takes each of several values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    /// Path of the value in the job.
    pub path: String,
    pub values: Vec<Value>,
}

/// Name and argument of a draw; `None` for all other values.
fn draw(value: &Value) -> Option<(&str, &Value)> {
    let mut members = value.as_object().filter(|members| members.len() == 1)?.iter();
    members.next().filter(|(name, _)| name.starts_with('$') && *name != "$schema").map(|(name, of)| (name.as_str(), of))
}

/// Every `$each` of a job, in the order of its paths. Reports malformed draws.
pub(super) fn axes(job: &Value, at: &Path, faults: &mut Diagnostics) -> Vec<Axis> {
    let mut found = Vec::new();
    if let Some(("$each", Value::Array(values))) = draw(job) {
        values.iter().enumerate().for_each(|(i, value)| check(value, &at.key("$each").index(i), faults));
        faults.require(!values.is_empty(), at.key("$each"), "none", "one value or more");
        found.push(Axis { path: at.to_string(), values: values.clone() });
    } else if draw(job).is_some() {
        check(job, at, faults);
    } else {
        members(job, at, &mut |member, at| found.extend(axes(member, at, faults)));
    }
    found
}

/// Calls `visit` with each member or item of `value`.
fn members(value: &Value, at: &Path, visit: &mut dyn FnMut(&Value, &Path)) {
    match value {
        Value::Object(members) => members.iter().for_each(|(key, member)| visit(member, &at.key(key))),
        Value::Array(items) => items.iter().enumerate().for_each(|(i, item)| visit(item, &at.index(i))),
        _ => {}
    }
}

/// As [`members`], to be changed.
pub(super) fn members_mut(value: &mut Value, at: &Path, visit: &mut dyn FnMut(&mut Value, &Path)) {
    match value {
        Value::Object(members) => members.iter_mut().for_each(|(key, member)| visit(member, &at.key(key))),
        Value::Array(items) => items.iter_mut().enumerate().for_each(|(i, item)| visit(item, &at.index(i))),
        _ => {}
    }
}

/// Reports what is wrong with the draws in `value`, which is below no `$each` but its own.
fn check(value: &Value, at: &Path, faults: &mut Diagnostics) {
    let Some((name, argument)) = draw(value) else {
        return members(value, at, &mut |member, at| check(member, at, faults));
    };
    let inner = at.key(name);
    let allowed = match name {
        "$one_of" if argument.as_array().is_some_and(|choices| !choices.is_empty()) => {
            return members(argument, &inner, &mut |member, at| check(member, at, faults));
        }
        "$one_of" => "a list of one value or more",
        "$uniform" | "$integer" | "$log_uniform" if ends(name, argument).is_some() => return,
        "$uniform" => "the least and the largest number",
        "$integer" => "the least and the largest whole number",
        "$log_uniform" => "the least and the largest number, of one sign",
        "$places" if Places::of(argument).is_some() => return,
        "$places" if argument.as_object().is_some_and(|members| members.values().any(|of| draw(of).is_some())) => {
            return members(argument, &inner, &mut |member, at| check(member, at, faults));
        }
        "$places" => r#"{"apart_mm": least distance of two, "within_mm": largest coordinate}"#,
        "$plus" if argument.as_array().is_some_and(|pair| pair.len() == 2 && pair[0].is_string()) => {
            return check(&argument[1], &inner.index(1), faults);
        }
        "$plus" => "the name of a member of the same object, and a number",
        "$faults" if FaultDraw::of(argument).is_some() => return,
        "$faults" => r#"{"most": 1 to 8, "until_s": when all of them end}, or less of it"#,
        "$each" => return faults.push(at, "$each within another draw", "$each outside of draws"),
        other => return faults.push(at, format!("{other:?}"), one_of(other, &DRAWS)),
    };
    faults.push(inner, shown(argument), allowed);
}

/// Ends of a range that is drawn from.
fn ends(name: &str, argument: &Value) -> Option<[f64; 2]> {
    let [least, most] = argument.as_array()?.as_slice() else { return None };
    let [least, most] = [least.as_f64()?, most.as_f64()?];
    let fits = match name {
        "$integer" => least.fract() == 0.0 && most.fract() == 0.0 && least.abs().max(most.abs()) < 1e15,
        "$log_uniform" => least * most > 0.0,
        _ => true,
    };
    (fits && least <= most).then_some([least, most])
}

/// Random places: distance of two, largest coordinate, mm, and how many; of all parts of the job if `None`.
struct Places(f64, f64, Option<u64>);

impl Places {
    fn of(argument: &Value) -> Option<Self> {
        let number = |key| argument[key].as_f64();
        let (apart_mm, within_mm) = (number("apart_mm")?, number("within_mm")?);
        let count = argument["count"].as_u64();
        let fits = apart_mm >= 0.0 && within_mm > 0.0 && count.is_none_or(|count| count <= MOST_PLACES);
        fits.then_some(Self(apart_mm, within_mm, count))
    }

    fn places_mm(&self, parts: u64, rng: &mut Rng) -> Option<Vec<[f64; 2]>> {
        let &Self(apart_mm, within_mm, count) = self;
        let (count, mut places_mm) = (count.unwrap_or(parts).min(MOST_PLACES) as usize, Vec::<[f64; 2]>::new());
        for _ in 0..TRIES * count {
            if places_mm.len() == count {
                break;
            }
            let [x, y] = [(); 2].map(|()| (within(-within_mm, within_mm, rng) * 1e3).round() / 1e3);
            let is_free = |&[a, b]: &[f64; 2]| libm::hypot(x - a, y - b) >= apart_mm;
            places_mm.extend(places_mm.iter().all(is_free).then_some([x, y]));
        }
        (places_mm.len() == count).then_some(places_mm)
    }
}

/// The job of one run: `choices` are those of the axes, and everything else is drawn from `streams`, each value from a
/// stream named after its path. Reports draws that cannot be made.
pub(super) fn drawn(job: &Value, choices: &[(&Axis, usize)], streams: Streams, faults: &mut Diagnostics) -> Value {
    let mut drawing = Drawing { choices, streams, faults };
    let mut job = drawing.value(job, &Path::root());
    let count = |entry: &Value| entry["count"].as_u64().unwrap_or(1);
    let parts = job["parts"].as_array().map_or(0, |entries| entries.iter().map(count).sum());
    let hold_s = job["task"]["duration_s"].as_f64();
    drawing.fill(&mut job, &Path::root(), (parts, hold_s));
    job
}

struct Drawing<'a> {
    choices: &'a [(&'a Axis, usize)],
    streams: Streams,
    faults: &'a mut Diagnostics,
}

impl Drawing<'_> {
    /// `value` without draws, those aside that ask for the whole job.
    fn value(&mut self, value: &Value, at: &Path) -> Value {
        let mut rng = self.streams.stream(&format!("campaign {at}"));
        match (draw(value), value) {
            (Some(("$each", _)), _) => {
                let path = at.to_string();
                let chosen = self.choices.iter().find(|(axis, _)| axis.path == path);
                chosen.map_or(Value::Null, |(axis, choice)| self.value(&axis.values[*choice], &at.key("$each")))
            }
            (Some(("$one_of", Value::Array(choices))), _) => {
                self.value(&choices[index(choices.len(), &mut rng)], &at.key("$one_of"))
            }
            (Some((name @ ("$uniform" | "$integer" | "$log_uniform"), argument)), _) => {
                let Some([least, most]) = ends(name, argument) else { return Value::Null };
                match name {
                    "$integer" => json!(within(least, most + 1.0, &mut rng).floor().min(most) as i64),
                    "$uniform" => json!(within(least, most, &mut rng)),
                    _ => json!(log_within(least, most, &mut rng)),
                }
            }
            (_, Value::Object(members)) => self.members(members, at),
            (_, Value::Array(items)) => {
                items.iter().enumerate().map(|(i, item)| self.value(item, &at.index(i))).collect()
            }
            _ => value.clone(),
        }
    }

    /// The members of an object; sums of one of them come last.
    fn members(&mut self, members: &Map<String, Value>, at: &Path) -> Value {
        let is_sum = |member: &Value| draw(member).is_some_and(|(name, _)| name == "$plus");
        let plain = members.iter().filter(|(_, member)| !is_sum(member));
        let mut made: Map<String, Value> =
            plain.map(|(key, member)| (key.clone(), self.value(member, &at.key(key)))).collect();
        for (key, member) in members.iter().filter(|(_, member)| is_sum(member)) {
            let pair = &member["$plus"];
            let more = self.value(&pair[1], &at.key(key));
            let sum = made.get(pair[0].as_str().unwrap_or_default()).and_then(Value::as_f64).zip(more.as_f64());
            self.faults.require(sum.is_some(), at.key(key).key("$plus"), shown(pair), "two numbers");
            made.insert(key.clone(), json!(sum.map(|(a, b)| a + b)));
        }
        Value::Object(made)
    }

    /// Fills in draws that ask for the number of parts, and the time that the job holds them for, s.
    fn fill(&mut self, value: &mut Value, at: &Path, job: (u64, Option<f64>)) {
        let mut rng = self.streams.stream(&format!("campaign {at}"));
        match draw(value) {
            Some(("$places", argument)) => {
                // draws in the argument are made
                let made = Places::of(argument).and_then(|places| places.places_mm(job.0, &mut rng));
                let found = format!("no room for {}", counted(job.0 as usize, "part"));
                self.faults.require(made.is_some(), at.key("$places"), found, "fewer, or less apart_mm");
                *value = json!(made);
            }
            Some(("$faults", argument)) => {
                *value = FaultDraw::of(argument).map_or(Value::Null, |of| fault_draws::drawn(&of, job, &mut rng));
            }
            _ => members_mut(value, at, &mut |member, at| self.fill(member, at, job)),
        }
    }
}
