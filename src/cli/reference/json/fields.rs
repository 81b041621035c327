//! The fields of a type as its JSON Schema says them.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value};

/// A field of what is printed.
pub(super) struct Field {
    /// Names from the outside, `[]` = an element of a list, NAME = any name.
    pub path: String,
    /// Type, in words.
    pub kind: String,
    /// Unit; "" = none.
    pub unit: String,
    /// What it is.
    pub meaning: String,
    /// Whether it is left out where it says nothing.
    pub optional: bool,
}

/// Path of the name in a map.
const NAME: &str = "NAME";

/// All fields of a type as it is printed.
pub(super) fn of<T: JsonSchema>() -> Vec<Field> {
    let settings = SchemaSettings::draft2020_12().for_serialize();
    let settings = settings.with(|s| s.inline_subschemas = true);
    let schema = settings.into_generator().into_root_schema_for::<T>();
    let mut fields = Vec::new();
    within("", schema.as_value(), &mut fields);
    fields
}

/// Fields of what a schema says, below `path`.
fn within(path: &str, schema: &Value, fields: &mut Vec<Field>) {
    let below = |name: &str| match path {
        "" => name.to_owned(),
        _ => format!("{path}.{name}"),
    };
    if let Some(properties) = schema["properties"].as_object() {
        let required = schema["required"].as_array();
        for (name, of) in properties {
            let always = required.is_some_and(|r| r.iter().any(|v| v == name));
            add(below(name), of, !always, fields);
        }
    }
    if schema["additionalProperties"].is_object() {
        let of = &schema["additionalProperties"];
        let about = schema["description"].as_str();
        let before = fields.len();
        add(below(NAME), of, false, fields);
        // What the map is says what its entries are.
        if let (Some(about), Some(entry)) = (about, fields.get_mut(before))
            && entry.meaning.is_empty()
        {
            (entry.meaning, entry.unit) = described(about);
        }
    }
    let items = [&schema["items"]].into_iter().filter(|i| i.is_object());
    for element in items.chain(list(schema, "prefixItems")) {
        within(&format!("{path}[]"), element, fields);
    }
    for part in list(schema, "anyOf")
        .chain(list(schema, "oneOf"))
        .chain(list(schema, "allOf"))
    {
        within(path, part, fields);
    }
}

fn add(path: String, schema: &Value, optional: bool, fields: &mut Vec<Field>) {
    // A variant of an enum after the first repeats what they have in common, such as its tag.
    if let Some(known) = fields.iter_mut().find(|f| f.path == path) {
        let kind = kind(schema);
        if known.kind != kind {
            known.kind = format!("{} or {kind}", known.kind);
        }
        return;
    }
    let (mut meaning, unit) = described(schema["description"].as_str().unwrap_or_default());
    for (word, about) in variants(schema) {
        let about = about.trim_end_matches('.');
        meaning.push_str(&format!(" `\"{word}\"`: {about}."));
    }
    let kind = kind(schema);
    let unit = match unit.is_empty() && kind.contains("number") {
        true => unit_of_name(&path).to_owned(),
        false => unit,
    };
    fields.push(Field {
        path: path.clone(),
        kind,
        unit,
        meaning,
        optional,
    });
    within(&path, schema, fields);
}

/// Elements of a list within a schema.
fn list<'a>(schema: &'a Value, key: &str) -> impl Iterator<Item = &'a Value> {
    schema[key].as_array().into_iter().flatten()
}

/// The type in words.
fn kind(schema: &Value) -> String {
    let Some(of) = schema.as_object() else {
        return "anything".to_owned();
    };
    let words: Vec<String> = words(of);
    if !words.is_empty() {
        let null = allows_null(of);
        let words = words.join(", ");
        return if null {
            format!("{words} or null")
        } else {
            words
        };
    }
    let parts: Vec<&Value> = list(schema, "anyOf").chain(list(schema, "oneOf")).collect();
    if !parts.is_empty() {
        let mut kinds: Vec<String> = Vec::new();
        for kind in parts.into_iter().map(kind) {
            if !kinds.contains(&kind) {
                kinds.push(kind);
            }
        }
        return kinds.join(" or ");
    }
    let kinds: Vec<String> = match &schema["type"] {
        Value::String(name) => vec![simple(name, schema)],
        Value::Array(names) => {
            let names = names.iter().filter_map(Value::as_str);
            names.map(|name| simple(name, schema)).collect()
        }
        _ => vec!["anything".to_owned()],
    };
    kinds.join(" or ")
}

fn simple(name: &str, schema: &Value) -> String {
    match name {
        "integer" => "whole number".to_owned(),
        "boolean" => "true or false".to_owned(),
        "string" => "text".to_owned(),
        "array" => elements(schema),
        other => other.to_owned(),
    }
}

/// A list by its elements: "list of numbers", "list of 6 numbers", "list of number, text".
fn elements(schema: &Value) -> String {
    let parts: Vec<String> = list(schema, "prefixItems").map(kind).collect();
    if let Some(first) = parts.first() {
        return match parts.iter().all(|p| p == first) {
            true => format!("list of {} {}", parts.len(), plural(first)),
            false => format!("list of {}", parts.join(", ")),
        };
    }
    let of = plural(&kind(&schema["items"]));
    match (schema["minItems"].as_u64(), schema["maxItems"].as_u64()) {
        (Some(least), Some(most)) if least == most => format!("list of {least} {of}"),
        _ => format!("list of {of}"),
    }
}

fn plural(kind: &str) -> String {
    match kind {
        "number" | "whole number" | "text" | "object" => format!("{kind}s"),
        _ => match kind.strip_prefix("list of ") {
            Some(of) => format!("lists of {of}"),
            None => format!("({kind})"),
        },
    }
}

/// Words that a text may be, quoted.
fn words(schema: &Map<String, Value>) -> Vec<String> {
    let quoted = |word: &Value| word.as_str().map(|word| format!("`\"{word}\"`"));
    if let Some(word) = schema.get("const") {
        return quoted(word).into_iter().collect();
    }
    let listed = schema.get("enum").and_then(Value::as_array);
    if let Some(listed) = listed {
        return listed.iter().filter_map(quoted).collect();
    }
    let variants = schema.get("oneOf").and_then(Value::as_array);
    let variants = variants.into_iter().flatten();
    let each: Vec<Vec<String>> = variants
        .map(|v| v.as_object().map(words).unwrap_or_default())
        .collect();
    match each.iter().any(Vec::is_empty) {
        true => Vec::new(),
        false => each.concat(),
    }
}

/// Words that a text may be, with what each means.
fn variants(schema: &Value) -> Vec<(String, String)> {
    let parts = list(schema, "anyOf").chain(list(schema, "oneOf"));
    let each = parts.flat_map(|v| match (v["const"].as_str(), v["description"].as_str()) {
        (Some(word), Some(about)) => vec![(word.to_owned(), described(about).0)],
        _ => variants(v),
    });
    each.collect()
}

fn allows_null(schema: &Map<String, Value>) -> bool {
    let listed = schema.get("enum").and_then(Value::as_array);
    listed.is_some_and(|l| l.contains(&Value::Null))
}

/// Meaning and unit of a doc comment: the unit stands in `\[ \]`; what is `None` there is null here.
fn described(doc: &str) -> (String, String) {
    let doc = doc
        .replace("`None`", "`null`")
        .replace("[`", "`")
        .replace("`]", "`");
    let units = doc.split_once("\\[").and_then(|(before, rest)| {
        let (unit, after) = rest.split_once("\\]")?;
        Some((
            before.trim_end().to_owned(),
            unit.to_owned(),
            after.to_owned(),
        ))
    });
    match units {
        Some((before, unit, after)) => (tidy(&format!("{before}{after}")), unit),
        None => (tidy(&doc), String::new()),
    }
}

fn tidy(text: &str) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").replace("\\[", "[").replace("\\]", "]")
}

/// Unit by the ending of a name.
fn unit_of_name(path: &str) -> &'static str {
    const ENDINGS: [(&str, &str); 20] = [
        ("_ns", "ns"),
        ("_us", "us"),
        ("_s", "s"),
        ("_min", "min"),
        ("_m", "m"),
        ("_mm", "mm"),
        ("_px", "px"),
        ("_rad", "rad"),
        ("_deg", "deg"),
        ("_n", "N"),
        ("_v", "V"),
        ("_hz", "1/s"),
        ("_fps", "1/s"),
        ("_mps", "m/s"),
        ("_radps", "rad/s"),
        ("_bytes", "bytes"),
        ("_levels", "grey levels"),
        ("_nats", "nats"),
        ("_ppm", "1e-6"),
        ("_sds", "standard deviations"),
    ];
    let found = ENDINGS.iter().find(|(ending, _)| path.ends_with(ending));
    found.map_or("", |(_, unit)| unit)
}
