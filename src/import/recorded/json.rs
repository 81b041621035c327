//! Messages in JSON.

use serde_json::Value;

use super::message::{ELEMENTS_MAX, Leaves, Number};

pub(super) fn decode(data: &[u8], leaves: &mut Leaves) -> Result<(), String> {
    let value: Value = serde_json::from_slice(data).map_err(|e| format!("no JSON: {e}"))?;
    fields(&value, leaves);
    Ok(())
}

/// Depth is bounded by the parser.
fn fields(value: &Value, leaves: &mut Leaves) {
    match value {
        Value::Bool(v) => leaves.number(Number::UInt((*v).into())),
        Value::Number(n) => {
            let own = n
                .as_i64()
                .map(Number::Int)
                .or_else(|| n.as_u64().map(Number::UInt))
                .or_else(|| n.as_f64().map(Number::Float));
            if let Some(own) = own {
                leaves.number(own);
            }
        }
        Value::String(text) => leaves.text(text),
        Value::Array(list) => {
            for (index, item) in list.iter().take(ELEMENTS_MAX).enumerate() {
                let before = leaves.enter_element(index);
                fields(item, leaves);
                leaves.leave(before);
            }
        }
        Value::Object(map) => {
            for (name, item) in map {
                let before = leaves.enter(name);
                fields(item, leaves);
                leaves.leave(before);
            }
        }
        Value::Null => {}
    }
}
