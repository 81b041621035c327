//! Messages in protobuf, by the descriptor that stands in the log.

use prost_reflect::{
    DescriptorPool, DynamicMessage, Kind, MessageDescriptor, ReflectMessage, Value,
};

use super::message::{ELEMENTS_MAX, Leaves, Number};

const DEPTH_MAX: usize = 24;

/// The type of a log's messages by the log's own descriptors, or, where they do not define it, as Foxglove publishes it.
pub(super) fn descriptor(name: &str, set: &[u8]) -> Result<MessageDescriptor, String> {
    defined(name, set).or_else(|why| {
        let published = hydroline_log::published_schema(name).ok_or_else(|| why.clone())?;
        defined(name, &published.data).map_err(|_| why)
    })
}

fn defined(name: &str, set: &[u8]) -> Result<MessageDescriptor, String> {
    let pool = DescriptorPool::decode(set).map_err(|e| format!("its schema: {e}"))?;
    pool.get_message_by_name(name)
        .ok_or_else(|| format!("its schema does not define '{name}'"))
}

pub(super) fn decode(
    descriptor: &MessageDescriptor,
    data: &[u8],
    leaves: &mut Leaves,
) -> Result<(), String> {
    let message = DynamicMessage::decode(descriptor.clone(), data).map_err(|e| e.to_string())?;
    fields(&message, leaves, 0);
    Ok(())
}

fn fields(message: &DynamicMessage, leaves: &mut Leaves, depth: usize) {
    if depth > DEPTH_MAX {
        return;
    }
    for field in message.descriptor().fields() {
        // A number that is 0 is not on the wire; what may be absent and is, is nothing.
        let optional = field.supports_presence() || matches!(field.kind(), Kind::Message(_));
        if leaves.is_full() || (optional && !message.has_field(&field)) {
            continue;
        }
        let before = leaves.enter(field.name());
        value(&message.get_field(&field), leaves, depth);
        leaves.leave(before);
    }
}

fn value(value_: &Value, leaves: &mut Leaves, depth: usize) {
    match value_ {
        Value::Bool(v) => leaves.number(Number::UInt((*v).into())),
        Value::I32(v) | Value::EnumNumber(v) => leaves.number(Number::Int((*v).into())),
        Value::I64(v) => leaves.number(Number::Int(*v)),
        Value::U32(v) => leaves.number(Number::UInt((*v).into())),
        Value::U64(v) => leaves.number(Number::UInt(*v)),
        Value::F32(v) => leaves.number(Number::Float((*v).into())),
        Value::F64(v) => leaves.number(Number::Float(*v)),
        Value::String(text) => leaves.text(text),
        Value::Message(inner) => fields(inner, leaves, depth + 1),
        Value::List(list) => {
            for (index, item) in list.iter().take(ELEMENTS_MAX).enumerate() {
                let before = leaves.enter_element(index);
                value(item, leaves, depth + 1);
                leaves.leave(before);
            }
        }
        Value::Bytes(_) | Value::Map(_) => {}
    }
}
