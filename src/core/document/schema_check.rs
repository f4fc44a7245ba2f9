use serde_json::{Map, Value};

use super::diagnostic::{Diagnostics, Path, listed, one_of, quoted, shown};

/// Checks `value` against the JSON Schema of a serde type and lists every deviation: unknown and missing keys, wrong
/// types, unknown words, numbers out of range. Supports exactly the keywords those schemas use.
pub(super) fn check(value: &Value, schema: &Value, at: &Path, faults: &mut Diagnostics) {
    Walker { root: schema, faults }.visit(value, schema, at);
}

struct Walker<'a> {
    root: &'a Value,
    faults: &'a mut Diagnostics,
}

impl<'a> Walker<'a> {
    fn visit(&mut self, value: &Value, schema: &'a Value, at: &Path) {
        let schema = self.resolve(schema);
        let words = words(schema);
        if !words.is_empty() {
            return self.visit_word(value, &words, at);
        }
        if let Some(variants) = alternatives(schema) {
            let variants: Vec<&Value> = variants.iter().map(|variant| self.resolve(variant)).collect();
            return match self.choose(value, &variants) {
                Some(chosen) => self.visit(value, chosen, at),
                None => self.blame(value, &variants, schema, at),
            };
        }
        if !fits_type(value, schema) {
            return self.faults.push(at, shown(value), self.allowed(schema));
        }
        match value {
            Value::Object(members) => self.visit_object(members, schema, at),
            Value::Array(items) => self.visit_list(items, schema, at),
            Value::Number(_) if !in_range(value, schema) => self.faults.push(at, shown(value), self.allowed(schema)),
            Value::String(text) if !has_length(text.chars().count(), schema, "minLength", "maxLength") => {
                self.faults.push(at, shown(value), self.allowed(schema));
            }
            _ => {}
        }
    }

    /// Follows `$ref` to its definition.
    fn resolve(&self, schema: &'a Value) -> &'a Value {
        let target = schema.get("$ref").and_then(Value::as_str).and_then(|path| path.strip_prefix('#'));
        target.and_then(|pointer| self.root.pointer(pointer)).unwrap_or(schema)
    }

    fn visit_word(&mut self, value: &Value, words: &[&str], at: &Path) {
        let found = value.as_str();
        if !found.is_some_and(|word| words.contains(&word)) {
            self.faults.push(at, shown(value), one_of(found.unwrap_or_default(), words));
        }
    }

    /// The alternative that is meant: by its tag where all have one, otherwise by its type.
    fn choose(&self, value: &Value, variants: &[&'a Value]) -> Option<&'a Value> {
        let tagged = variants.iter().all(|variant| tag(variant).is_some());
        let found = value.get("type").and_then(Value::as_str);
        let meant = |variant: &&&Value| if tagged { tag(variant) == found } else { self.accepts(variant, value) };
        variants.iter().find(meant).copied()
    }

    /// True when `schema` allows the type of `value`.
    fn accepts(&self, schema: &'a Value, value: &Value) -> bool {
        match alternatives(schema) {
            Some(variants) => variants.iter().any(|variant| self.accepts(self.resolve(variant), value)),
            None => fits_type(value, schema),
        }
    }

    /// Adds the fault of a value that matches none of the alternatives.
    fn blame(&mut self, value: &Value, variants: &[&'a Value], schema: &'a Value, at: &Path) {
        let tags: Vec<&str> = variants.iter().filter_map(|variant| tag(variant)).collect();
        if value.is_object() && tags.len() == variants.len() {
            let found = value.get("type");
            let word = found.and_then(Value::as_str).unwrap_or_default();
            match found {
                Some(found) => self.faults.push(at.key("type"), shown(found), one_of(word, &tags)),
                None => self.faults.push_missing(at.key("type"), one_of(word, &tags)),
            }
        } else {
            self.faults.push(at, shown(value), self.allowed(schema));
        }
    }

    fn visit_object(&mut self, members: &Map<String, Value>, schema: &'a Value, at: &Path) {
        let known = schema.get("properties").and_then(Value::as_object);
        let member_of = |key: &str| known.and_then(|known| known.get(key));
        for (key, value) in members {
            match (member_of(key), schema.get("additionalProperties")) {
                (None, Some(Value::Bool(false))) => {
                    let keys: Vec<&str> = known.into_iter().flat_map(Map::keys).map(String::as_str).collect();
                    let found = format!("unknown key {}", quoted(key));
                    self.faults.push(at.key(key), found, one_of(key, &keys));
                }
                (Some(member), _) | (None, Some(member)) => self.visit(value, member, &at.key(key)),
                (None, None) => {}
            }
        }
        let required = schema.get("required").and_then(Value::as_array).into_iter().flatten();
        for key in required.filter_map(Value::as_str).filter(|key| !members.contains_key(*key)) {
            let allowed = member_of(key).map(|member| self.allowed(member));
            self.faults.push_missing(at.key(key), allowed.unwrap_or_default());
        }
    }

    fn visit_list(&mut self, items: &[Value], schema: &'a Value, at: &Path) {
        if !has_length(items.len(), schema, "minItems", "maxItems") {
            self.faults.push(at, format!("a list of {}", items.len()), self.allowed(schema));
        }
        if let Some(of) = schema.get("items") {
            for (i, item) in items.iter().enumerate() {
                self.visit(item, of, &at.index(i));
            }
        }
    }

    /// The values that fit `schema`, in words.
    fn allowed(&self, schema: &'a Value) -> String {
        let schema = self.resolve(schema);
        let words = words(schema);
        if !words.is_empty() {
            return listed(&words);
        }
        if let Some(variants) = alternatives(schema) {
            let tags: Vec<&str> = variants.iter().filter_map(tag).collect();
            if tags.len() == variants.len() {
                return format!("an object with type {}", tags.join(" or "));
            }
            let names: Vec<String> = variants.iter().map(|variant| self.allowed(variant)).collect();
            return names.join(" or ");
        }
        let names: Vec<String> = types(schema).iter().map(|name| self.described(name, schema)).collect();
        names.join(" or ")
    }

    fn described(&self, name: &str, schema: &'a Value) -> String {
        let title = schema.get("title").and_then(Value::as_str);
        match name {
            "integer" if schema.get("enum").is_some() => {
                let numbers = schema.get("enum").and_then(Value::as_array).into_iter().flatten();
                numbers.map(Value::to_string).collect::<Vec<_>>().join(" or ")
            }
            "number" => format!("a number{}", range(schema)),
            "integer" if schema.get("maximum").is_none() => format!("a whole number{} in 64 bits", range(schema)),
            "integer" => format!("a whole number{}", range(schema)),
            "string" if title.is_some() => format!("a {}", title.unwrap_or_default()),
            "string" => match schema.get("maxLength") {
                Some(_) => format!("a string of{}", lengths(schema, "minLength", "maxLength", " characters")),
                None => "a string".to_owned(),
            },
            "array" => {
                let of = schema.get("items").map(|items| self.allowed(items)).unwrap_or_default();
                format!("a list of{} ({of} each)", lengths(schema, "minItems", "maxItems", " items"))
            }
            "boolean" => "true or false".to_owned(),
            "object" => title.map_or("an object".to_owned(), |title| format!("a {title} object")),
            other => other.to_owned(),
        }
    }
}

/// Words of an enumeration, in its order.
fn words(schema: &Value) -> Vec<&str> {
    let listed = schema.get("enum").and_then(Value::as_array).into_iter().flatten();
    let constants = alternatives(schema).into_iter().flatten().filter_map(|variant| variant.get("const"));
    listed.chain(constants).filter_map(Value::as_str).collect()
}

fn alternatives(schema: &Value) -> Option<&Vec<Value>> {
    schema.get("oneOf").or_else(|| schema.get("anyOf")).and_then(Value::as_array)
}

/// The constant under `type` that distinguishes one alternative from the others.
fn tag(schema: &Value) -> Option<&str> {
    schema.pointer("/properties/type/const").and_then(Value::as_str)
}

fn types(schema: &Value) -> Vec<&str> {
    match schema.get("type") {
        Some(Value::String(name)) => vec![name],
        Some(Value::Array(names)) => names.iter().filter_map(Value::as_str).collect(),
        _ => Vec::new(),
    }
}

fn fits_type(value: &Value, schema: &Value) -> bool {
    let types = types(schema);
    types.is_empty()
        || types.iter().any(|name| match *name {
            "number" => value.is_number(),
            "integer" => value.is_u64() || value.is_i64(),
            "string" => value.is_string(),
            "array" => value.is_array(),
            "object" => value.is_object(),
            "boolean" => value.is_boolean(),
            _ => value.is_null(),
        })
}

fn in_range(value: &Value, schema: &Value) -> bool {
    let Some(found) = value.as_f64() else { return false };
    let holds = |key, test: fn(f64, f64) -> bool| {
        schema.get(key).and_then(Value::as_f64).is_none_or(|limit| test(found, limit))
    };
    let listed = schema.get("enum").and_then(Value::as_array).is_none_or(|numbers| numbers.contains(value));
    found.is_finite()
        && listed
        && holds("minimum", |x, limit| x >= limit)
        && holds("maximum", |x, limit| x <= limit)
        && holds("exclusiveMinimum", |x, limit| x > limit)
}

fn has_length(length: usize, schema: &Value, min: &str, max: &str) -> bool {
    let limit = |key| schema.get(key).and_then(Value::as_u64);
    limit(min).is_none_or(|min| length as u64 >= min) && limit(max).is_none_or(|max| length as u64 <= max)
}

/// ` from 0 to 1`, ` above 0, up to 9`; empty without limits.
fn range(schema: &Value) -> String {
    let limit = |key| schema.get(key).and_then(Value::as_f64);
    let low = limit("minimum").map(|x| format!("from {x}")).or(limit("exclusiveMinimum").map(|x| format!("above {x}")));
    let most = |x: f64| if x < u64::MAX as f64 { format!("to {x}") } else { "in 64 bits".to_owned() };
    let high = limit("maximum").map(most);
    let comma = if schema.get("minimum").is_none() && low.is_some() { ", up" } else { "" };
    match (low, high) {
        (Some(low), Some(high)) => format!(" {low}{comma} {high}"),
        (low, high) => low.or(high).map(|text| format!(" {text}")).unwrap_or_default(),
    }
}

fn lengths(schema: &Value, min: &str, max: &str, of: &str) -> String {
    match (schema.get(min), schema.get(max)) {
        (Some(min), Some(max)) if min == max => format!(" {min}{of}"),
        (Some(min), Some(max)) => format!(" {min} to {max}{of}"),
        (Some(min), None) => format!(" {min} or more{of}"),
        (None, Some(max)) => format!(" up to {max}{of}"),
        (None, None) => of.to_owned(),
    }
}
