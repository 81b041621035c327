//! Message definitions of ROS: text into types.

use std::collections::BTreeMap;

/// Types of one schema; cyclic definitions are found by depth.
pub(crate) const DEPTH_MAX: usize = 24;
/// Structures in one schema.
const TYPES_MAX: usize = 1000;
/// Fields in one schema.
const FIELDS_MAX: usize = 20_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Primitive {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

impl Primitive {
    pub fn bytes(self) -> usize {
        match self {
            Primitive::Bool | Primitive::U8 | Primitive::I8 => 1,
            Primitive::U16 | Primitive::I16 => 2,
            Primitive::U32 | Primitive::I32 | Primitive::F32 => 4,
            Primitive::U64 | Primitive::I64 | Primitive::F64 => 8,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Base {
    Primitive(Primitive),
    Text,
    WideText,
    /// Place in [`Definition::types`].
    Struct(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Many {
    One,
    Fixed(usize),
    Sequence,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Field {
    pub name: String,
    pub base: Base,
    pub many: Many,
}

/// A message's types; the first is its own.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Definition {
    pub types: Vec<Vec<Field>>,
}

/// Fields as typed: (type, name).
type Typed = Vec<(String, String)>;

/// `nav_msgs/msg/Odometry` as `nav_msgs/Odometry`.
fn short(name: &str) -> String {
    let mut parts: Vec<&str> = name.trim().split('/').collect();
    parts.retain(|p| !matches!(*p, "msg" | "srv" | "action" | ""));
    parts.join("/")
}

fn lines(text: &str) -> Typed {
    let mut fields = Typed::new();
    for line in text.lines() {
        // A text's default may hold a #; nothing after the name counts here.
        let line = line.split('#').next().unwrap_or("").trim();
        let mut words = line.split_whitespace();
        let (Some(kind), Some(name)) = (words.next(), words.next()) else {
            continue;
        };
        let rest = line[kind.len()..].trim_start();
        let after = rest.get(name.len()..).unwrap_or("").trim_start();
        // Constants are no fields; defaults do not matter.
        if name.contains('=') || after.starts_with('=') {
            continue;
        }
        fields.push((kind.to_owned(), name.to_owned()));
    }
    fields
}

fn primitive(word: &str) -> Option<Primitive> {
    Some(match word {
        "bool" => Primitive::Bool,
        "byte" | "uint8" | "char" | "octet" => Primitive::U8,
        "int8" => Primitive::I8,
        "uint16" => Primitive::U16,
        "int16" => Primitive::I16,
        "uint32" => Primitive::U32,
        "int32" => Primitive::I32,
        "uint64" => Primitive::U64,
        "int64" => Primitive::I64,
        "float32" => Primitive::F32,
        "float64" => Primitive::F64,
        _ => return None,
    })
}

/// The type's name without its array, and the array.
fn array(word: &str) -> Option<(&str, Many)> {
    let Some((base, rest)) = word.split_once('[') else {
        return Some((word, Many::One));
    };
    let inside = rest.strip_suffix(']')?;
    let many = if inside.is_empty() || inside.starts_with("<=") {
        Many::Sequence
    } else {
        Many::Fixed(inside.parse().ok()?)
    };
    Some((base, many))
}

/// Fields of each type of a schema; those before the first title are of the type `own`.
fn sections(own: &str, text: &str) -> BTreeMap<String, Typed> {
    let mut texts = BTreeMap::new();
    let mut title = own.to_owned();
    let mut section = String::new();
    for line in text.lines() {
        let line = line.trim_end();
        if line.len() >= 10 && line.bytes().all(|b| b == b'=') {
            texts.insert(std::mem::take(&mut title), lines(&section));
            section.clear();
        } else if let Some(name) = line.strip_prefix("MSG:") {
            title = short(name);
        } else {
            section.push_str(line);
            section.push('\n');
        }
    }
    texts.insert(title, lines(&section));
    texts
}

struct Compiler {
    texts: BTreeMap<String, Typed>,
    places: BTreeMap<String, usize>,
    types: Vec<Vec<Field>>,
    fields: usize,
}

impl Compiler {
    /// The name under which a type is known, seen from a package.
    fn resolve(&self, word: &str, package: &str) -> Result<String, String> {
        let own = short(word);
        let own = match own.as_str() {
            "Header" => "std_msgs/Header".to_owned(),
            "time" => "builtin_interfaces/Time".to_owned(),
            "duration" => "builtin_interfaces/Duration".to_owned(),
            _ => own,
        };
        if self.texts.contains_key(&own) {
            return Ok(own);
        }
        let near = format!("{package}/{own}");
        if self.texts.contains_key(&near) {
            return Ok(near);
        }
        let ending = format!("/{own}");
        self.texts
            .keys()
            .find(|k| k.ends_with(&ending))
            .cloned()
            .ok_or_else(|| format!("the schema does not define '{word}'"))
    }

    fn compile(&mut self, name: &str, depth: usize) -> Result<usize, String> {
        if let Some(place) = self.places.get(name) {
            return Ok(*place);
        }
        if depth > DEPTH_MAX || self.types.len() > TYPES_MAX {
            return Err(format!("the schema is nested beyond {DEPTH_MAX} types"));
        }
        let typed = self.texts.get(name).cloned().unwrap_or_default();
        self.fields += typed.len();
        if self.fields > FIELDS_MAX {
            return Err(format!("the schema has more than {FIELDS_MAX} fields"));
        }
        let place = self.types.len();
        self.places.insert(name.to_owned(), place);
        self.types.push(Vec::new());
        let package = name.split('/').next().unwrap_or("").to_owned();
        let mut fields = Vec::new();
        for (kind, field) in typed {
            let (word, many) = array(&kind).ok_or_else(|| format!("'{kind}' is no type of ROS"))?;
            let word = word.split("<=").next().unwrap_or(word);
            let base = match (primitive(word), word) {
                (Some(p), _) => Base::Primitive(p),
                (_, "string") => Base::Text,
                (_, "wstring") => Base::WideText,
                _ => {
                    let known = self.resolve(word, &package)?;
                    Base::Struct(self.compile(&known, depth + 1)?)
                }
            };
            fields.push(Field {
                name: field,
                base,
                many,
            });
        }
        self.types[place] = fields;
        Ok(place)
    }
}

impl Definition {
    /// Reads a schema as bags hold it: the message's own text, then `MSG: package/Type` after a line of `=`.
    pub fn parse(name: &str, text: &str) -> Result<Definition, String> {
        Definition::parse_with(name, text, "")
    }

    /// The same; types that the text uses and does not define are looked for in `others`, a text of the same form.
    pub fn parse_with(name: &str, text: &str, others: &str) -> Result<Definition, String> {
        if text.lines().any(|line| line.trim() == "---") {
            return Err(format!(
                "the schema of {name} is a service's or an action's text (request --- response), and its messages are laid out otherwise: record the values on a topic of their own"
            ));
        }
        let own = short(name);
        let mut texts = sections("", others);
        texts.extend(sections(&own, text));
        // Not in every schema, and the same in all.
        let two = |a: &str, b: &str| {
            vec![
                (a.to_owned(), "sec".to_owned()),
                (b.to_owned(), "nanosec".to_owned()),
            ]
        };
        texts
            .entry("builtin_interfaces/Time".to_owned())
            .or_insert_with(|| two("int32", "uint32"));
        texts
            .entry("builtin_interfaces/Duration".to_owned())
            .or_insert_with(|| two("int32", "uint32"));
        let mut compiler = Compiler {
            texts,
            places: BTreeMap::new(),
            types: Vec::new(),
            fields: 0,
        };
        compiler.compile(&own, 0)?;
        Ok(Definition {
            types: compiler.types,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_services_text_was_taken_for_its_events_and_gave_numbers_of_nothing() {
        // As rosbag2 wrote schemas of `_service_event` topics.
        let text = "bool a\nfloat64 b\n---\nbool a\nfloat64 b\n";
        let error = Definition::parse("test_msgs/srv/BasicTypes_Event", text).unwrap_err();
        assert!(error.contains("BasicTypes_Event"), "{error}");
        assert!(error.contains("request --- response"), "{error}");
        let own = "bool a\nfloat64 b\n";
        assert!(Definition::parse("my_msgs/msg/Own", own).is_ok());
    }
}
