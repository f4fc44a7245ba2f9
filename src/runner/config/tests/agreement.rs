//! Documents made from the printed schemas: the program reads those that a schema allows, and refuses all others. An
//! independent validator tells which these are.

use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use rand::RngExt;
use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};

use super::mutation::{experiment, places, whole};
use super::traces::trace;
use super::value_of;
use crate::config::campaign_file::CampaignFile;
use crate::config::coins::coins_of;
use crate::config::daemon_file::DaemonFile;
use crate::config::read::{BASE_PATH_PATTERN, NAME_PATTERN, PLAIN_NAME_PATTERN};
use crate::config::rig_changes::RigChanges;
use crate::config::simulate::ExperimentFile;
use crate::config::{Diagnostic, JobFile, RigFile, schema, schema_names};
use upm_core::document::parse;
use upm_core::random::{Rng, Streams};
use upm_core::signal::RecordedPulse;
use upm_planning::cor_library::Library;

/// Keywords that [`Maker::made`] heeds or that limit no value.
const KEYWORDS: &str = "$defs $ref $schema additionalProperties anyOf const default description enum exclusiveMinimum \
    format items maxItems maxLength maxProperties maximum minItems minLength minProperties minimum oneOf pattern \
    properties propertyNames required title type";

/// Makes documents that a schema allows.
struct Maker<'a> {
    root: &'a Value,
    rng: Rng,
}

impl Maker<'_> {
    fn pick<T: Clone>(&mut self, of: &[T]) -> T {
        of[self.rng.random_range(0..of.len())].clone()
    }

    fn made(&mut self, schema: &Value) -> Value {
        let unknown = schema.as_object().unwrap().keys().find(|key| !KEYWORDS.split(' ').any(|word| word == *key));
        assert_eq!(unknown, None, "{schema}");
        if let Some(default) = schema.get("default").filter(|_| self.rng.random_bool(0.1)) {
            return default.clone();
        }
        if let Some(target) = schema["$ref"].as_str() {
            return self.made(self.root.pointer(target.trim_start_matches('#')).unwrap());
        }
        if let Some(variants) = schema.get("oneOf").or(schema.get("anyOf")).and_then(Value::as_array) {
            let variant = self.pick(variants);
            return self.made(&variant);
        }
        if let Some(words) = schema.get("enum").and_then(Value::as_array) {
            return self.pick(words);
        }
        if let Some(word) = schema.get("const") {
            return word.clone();
        }
        let types = schema["type"].as_array().cloned().unwrap_or_else(|| vec![schema["type"].clone()]);
        let size = |key: &str, otherwise: usize| schema[key].as_u64().map_or(otherwise, |size| size as usize);
        match self.pick(&types).as_str().unwrap() {
            "null" => Value::Null,
            "boolean" => self.rng.random_bool(0.5).into(),
            "integer" => self.integer(schema),
            "number" => self.number(schema),
            "string" => self.text(schema, size("minLength", 0), size("maxLength", 99)),
            "array" => {
                let count = size("maxItems", 99).min(size("minItems", 0) + self.rng.random_range(0..3));
                (0..count).map(|_| self.made(&schema["items"])).collect()
            }
            "object" => self.object(schema, size("minProperties", 0)),
            other => unreachable!("a type {other}"),
        }
    }

    fn integer(&mut self, schema: &Value) -> Value {
        let limit = |key: &str| schema[key].as_i64().map(i128::from).or(schema[key].as_u64().map(i128::from)).unwrap();
        let (low, high) = (limit("minimum"), limit("maximum"));
        let all = [low, high, (low + high) / 2, 0, 1, 2, 100, 1 << 53, 1 << 62];
        let fitting: Vec<i128> = all.into_iter().filter(|whole| (low..=high).contains(whole)).collect();
        let whole = self.pick(&fitting);
        if self.rng.random_bool(0.3) && whole as f64 as i128 == whole {
            return if whole == 0 { -0.0 } else { whole as f64 }.into();
        }
        u64::try_from(whole).map_or_else(|_| (whole as i64).into(), Value::from)
    }

    fn number(&mut self, schema: &Value) -> Value {
        let limit = |key: &str, otherwise: f64| schema[key].as_f64().unwrap_or(otherwise);
        let (low, high) = (limit("minimum", -1e300), limit("maximum", 1e300));
        let all = [low, high, 0.5 * (low + high), 0.0, -0.0, 1.0, 2.5, 1e-9, f64::MIN_POSITIVE, -f64::MIN_POSITIVE];
        let above = limit("exclusiveMinimum", f64::NEG_INFINITY);
        let fitting: Vec<f64> = all.into_iter().filter(|x| (low..=high).contains(x) && *x > above).collect();
        self.pick(&fitting).into()
    }

    fn text(&mut self, schema: &Value, least: usize, most: usize) -> Value {
        let mut texts = ["a", "upm-1", "a.b", "_"].map(str::to_owned).to_vec();
        match schema["pattern"].as_str() {
            Some(PLAIN_NAME_PATTERN) => {}
            Some(BASE_PATH_PATTERN) => texts = ["/a", "/upm-1/a.b"].map(str::to_owned).to_vec(),
            Some(NAME_PATTERN) => texts.extend(["größe-1", "名前"].map(str::to_owned)),
            Some(pattern) => unreachable!("no samples of {pattern}"),
            None => {
                texts.extend(["", "penny", "é\u{0}\n", "𝄞\"\\"].map(str::to_owned));
                texts.push("é".repeat(most.min(4096)));
            }
        }
        texts.retain(|text| (least..=most).contains(&text.chars().count()));
        self.pick(&texts).into()
    }

    fn object(&mut self, schema: &Value, least: usize) -> Value {
        let mut members = Map::new();
        for (key, member) in schema["properties"].as_object().into_iter().flatten() {
            let is_required = schema["required"].as_array().is_some_and(|keys| keys.contains(&json!(key)));
            if is_required || self.rng.random_bool(0.4) {
                members.insert(key.clone(), self.made(member));
            }
        }
        if schema["additionalProperties"].is_object() {
            for key in ["a", "b.1-", "名前"].into_iter().take(least + self.rng.random_range(0..2)) {
                members.insert(key.to_owned(), self.made(&schema["additionalProperties"]));
            }
        }
        members.into()
    }

    /// Changes one value of `document`, mostly to one that is not allowed.
    fn change(&mut self, document: &mut Value) {
        let mut all = Vec::new();
        places(document, "", &mut all);
        let value = document.pointer_mut(&self.pick(&all)).unwrap();
        let others = [Value::Null, true.into(), "a".into(), "".into(), json!([]), json!({}), json!([null])];
        let numbers = [json!(-1), json!(0), json!(2.5), json!(1e19), json!(1e308), json!(u64::MAX)];
        let changed: Value = match (&*value, self.rng.random_range(0..4)) {
            (Value::Object(members), 0) => members.clone().into_iter().skip(1).collect(),
            (Value::Object(members), 1) => members.clone().into_iter().chain([("zzz".to_owned(), json!(1))]).collect(),
            (Value::Array(items), 0) => items.iter().chain(items).cloned().collect(),
            (Value::Array(items), 1) => items.iter().skip(1).cloned().collect(),
            (Value::Number(number), 0) => (0.0 - number.as_f64().unwrap()).into(),
            (Value::Number(number), 1) => (1.5 * number.as_f64().unwrap()).into(),
            (_, 2) => self.pick(&numbers),
            _ => self.pick(&others),
        };
        *value = changed;
    }
}

type Read = Result<(), Vec<Diagnostic>>;

/// Reads keys, types and ranges.
fn form<T: DeserializeOwned + JsonSchema + 'static>(text: &str) -> Read {
    parse::<T>(text, "f").map(drop)
}

/// Valid documents of the kind called `name`, and its reader; that of coins also counts them.
fn kind(name: &str) -> (Vec<Value>, fn(&str) -> Read) {
    let rig = || value_of("rigs/upm-2.json");
    match name {
        "job" => {
            let names = ["letters-16.json", "sort-12.json", "ballet-8.json", "bowtie-3.json", "trajectories.json"];
            (names.map(|name| whole(name, "rigs/upm-2.json")).to_vec(), form::<JobFile>)
        }
        "rig" => {
            let changes = || value_of("rigs/upm-2-evening.json");
            let read =
                |text: &str| if RigChanges::are_in(text) { form::<RigChanges>(text) } else { form::<RigFile>(text) };
            (vec![rig(), changes()], read)
        }
        "simulate" => (vec![experiment()], form::<ExperimentFile>),
        "library" => {
            let mut library = value_of("../assets/libraries/upm-2.json");
            for list in ["/entries", "/displacement/distance_mm", "/displacement/sd_mm"] {
                library.pointer_mut(list).unwrap().as_array_mut().unwrap().truncate(3);
            }
            (vec![library], form::<Library>)
        }
        "trace" => (vec![trace()], form::<RecordedPulse>),
        "daemon" => {
            (vec![value_of("daemon.json"), json!({"plates": [{"name": "a", "rig": rig()}]})], form::<DaemonFile>)
        }
        "coins" => (vec![value_of("coins/eu.json")], |text| coins_of(text, "f").map(drop)),
        "campaign" => (vec![value_of("campaigns/two-planners.json")], form::<CampaignFile>),
        other => unreachable!("no documents of {other}"),
    }
}

#[test]
fn a_document_is_read_exactly_if_its_schema_allows_it() {
    for name in schema_names() {
        let (schema, (shipped, read)) = (schema(name).unwrap(), kind(name));
        let (mut compiler, mut schemas) = (boon::Compiler::new(), boon::Schemas::new());
        compiler.add_resource("printed.json", schema.clone()).unwrap();
        let index = compiler.compile("printed.json", &mut schemas).unwrap();
        let config = ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() };
        let agree = |(seed, is_made, changes): (u64, bool, usize)| {
            let mut maker = Maker { root: &schema, rng: Streams::new(seed).stream("documents") };
            let mut document = if is_made { maker.made(&schema) } else { maker.pick(&shipped) };
            (0..changes).for_each(|_| maker.change(&mut document));
            let (text, read) = (document.to_string(), read(&document.to_string()));
            let fault = schemas.validate(&document, index).err().map(|error| error.to_string());
            prop_assert!(changes > 0 || fault.is_none(), "{name}: {text}: {fault:?}");
            prop_assert_eq!(read.is_ok(), fault.is_none(), "{}: {}: {:?}, {:?}", name, text, read, fault);
            Ok(())
        };
        TestRunner::new(config).run(&(any::<u64>(), any::<bool>(), 0..3_usize), agree).unwrap();
    }
}
