//! A run for Foxglove: the server's side of its WebSocket protocol, as far as a viewer that only looks needs it
//! (<https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md>).
//!
//! No I/O: text of the viewer goes in, messages for it come out. Foxglove's own server is not used because it answers every
//! site that a browser has open; this one sits behind the [guard](super::guard) of the live page.

mod messages;

pub use messages::{Sent, of_picture};

use bytes::{BufMut, Bytes, BytesMut};
use data_encoding::BASE64;
use hydroline_log::Topic;
use serde::Deserialize;
use serde_json::json;
use std::collections::BTreeMap;

/// Names of the protocol that viewers ask for: Foxglove's, and the one before it, which Lichtblick speaks.
pub const PROTOCOLS: [&str; 2] = ["foxglove.sdk.v1", "foxglove.websocket.v1"];
/// Where a viewer connects.
pub const PATH: &str = "/foxglove";
/// Image with stripe and target, pose, thrust, events.
const LAYOUT: &str = include_str!("foxglove/layout.json");
/// A viewer has one subscription per channel; more is not looking.
const SUBSCRIPTIONS_MAX: usize = 64;
/// Message data, first byte of a binary message.
const MESSAGE_DATA: u8 = 1;

/// Channels that a viewer may see: topics of the log under their names, and the state of the live page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// As in the log.
    Log(Topic),
    /// The page's state, JSON.
    State,
}

impl Channel {
    /// In the order of their numbers, from 1.
    pub const ALL: [Channel; 8] = [
        Channel::Log(Topic::CompressedImage),
        Channel::Log(Topic::Annotations),
        Channel::Log(Topic::Motion),
        Channel::Log(Topic::Pose),
        Channel::Log(Topic::Command),
        Channel::Log(Topic::Echo),
        Channel::Log(Topic::Event),
        Channel::State,
    ];

    /// Name of the topic.
    pub fn topic(self) -> &'static str {
        match self {
            Channel::Log(topic) => topic.name(),
            Channel::State => "/live/state",
        }
    }

    /// Whether it is made of pictures, which are made only while somebody looks.
    pub fn is_picture(self) -> bool {
        matches!(
            self,
            Channel::Log(Topic::CompressedImage | Topic::Annotations)
        )
    }

    fn advertised(self, id: usize) -> serde_json::Value {
        match self {
            Channel::Log(topic) => {
                let schema = topic.schema();
                json!({
                    "id": id,
                    "topic": self.topic(),
                    "encoding": "protobuf",
                    "schemaName": schema.name,
                    "schemaEncoding": "protobuf",
                    "schema": BASE64.encode(&schema.data),
                })
            }
            Channel::State => json!({
                "id": id,
                "topic": self.topic(),
                "encoding": "json",
                "schemaName": "",
                "schema": "",
            }),
        }
    }
}

/// The protocol that a viewer's `Sec-WebSocket-Protocol` and ours have in common.
pub fn protocol(offered: &str) -> Option<&'static str> {
    let of = |p: &&str| offered.split(',').any(|o| o.trim() == *p);
    PROTOCOLS.into_iter().find(of)
}

/// First messages to a viewer: the server and its channels. `session` changes from run of the program to run.
pub fn greeting(title: &str, session: &str) -> [String; 2] {
    let channels: Vec<_> = Channel::ALL
        .iter()
        .enumerate()
        .map(|(i, c)| c.advertised(i + 1))
        .collect();
    [
        json!({ "op": "serverInfo", "name": title, "capabilities": [], "sessionId": session }),
        json!({ "op": "advertise", "channels": channels }),
    ]
    .map(|m| m.to_string())
}

/// Messages of a viewer; all but subscriptions are `Other`.
#[derive(Debug, Deserialize)]
#[serde(tag = "op", rename_all = "camelCase")]
enum Heard {
    Subscribe {
        subscriptions: Vec<Wanted>,
    },
    #[serde(rename_all = "camelCase")]
    Unsubscribe {
        subscription_ids: Vec<u32>,
    },
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Wanted {
    id: u32,
    channel_id: u64,
}

/// One viewer: what it has subscribed to.
#[derive(Debug, Default)]
pub struct Viewer {
    subscriptions: BTreeMap<u32, Channel>,
}

impl Viewer {
    /// A text message of the viewer; what is no request of a viewer is answered by a status for it.
    pub fn hear(&mut self, text: &str) -> Option<String> {
        match serde_json::from_str(text) {
            Ok(Heard::Subscribe { subscriptions }) => {
                let mut refused = None;
                for wanted in subscriptions {
                    if let Err(words) = self.subscribe(&wanted) {
                        refused = Some(words);
                    }
                }
                refused.map(|words| status(&words))
            }
            Ok(Heard::Unsubscribe { subscription_ids }) => {
                for id in subscription_ids {
                    self.subscriptions.remove(&id);
                }
                None
            }
            Ok(Heard::Other) => Some(status("this server only shows; nothing can be set here")),
            Err(error) => Some(status(&format!("not understood: {error}"))),
        }
    }

    fn subscribe(&mut self, wanted: &Wanted) -> Result<(), String> {
        let place = usize::try_from(wanted.channel_id).ok();
        let place = place.and_then(|n| n.checked_sub(1));
        let channel = place.and_then(|i| Channel::ALL.get(i));
        let channel =
            channel.ok_or_else(|| format!("there is no channel {}", wanted.channel_id))?;
        if self.subscriptions.len() >= SUBSCRIPTIONS_MAX {
            return Err(format!("more than {SUBSCRIPTIONS_MAX} subscriptions"));
        }
        self.subscriptions.insert(wanted.id, *channel);
        Ok(())
    }

    /// Whether any of its subscriptions is of this kind.
    pub fn wants(&self, kind: impl Fn(Channel) -> bool) -> bool {
        self.subscriptions.values().any(|c| kind(*c))
    }

    /// A message of a channel at this time (UNIX \[ns\]), once per subscription.
    pub fn frames(&self, channel: Channel, at_ns: u64, data: &[u8]) -> Vec<Bytes> {
        let of = self.subscriptions.iter().filter(|(_, c)| **c == channel);
        of.map(|(id, _)| {
            let mut frame = BytesMut::with_capacity(13 + data.len());
            frame.put_u8(MESSAGE_DATA);
            frame.put_u32_le(*id);
            frame.put_u64_le(at_ns);
            frame.put_slice(data);
            frame.freeze()
        })
        .collect()
    }
}

/// A layout to import, for the live view and for logs alike: one line of thrust per thruster.
pub fn layout(thrusters: &[&str]) -> String {
    let Ok(mut layout) = serde_json::from_str::<serde_json::Value>(LAYOUT) else {
        return LAYOUT.to_owned();
    };
    let paths = thrusters.iter().map(|name| {
        let quoted = serde_json::Value::from(*name);
        json!({
            "value": format!("/thruster/command{{thruster=={quoted}}}.thrust_n"),
            "label": name,
            "enabled": true,
            "timestampMethod": "receiveTime",
        })
    });
    if !thrusters.is_empty() {
        layout["configById"]["Plot!thrust"]["paths"] = paths.collect();
    }
    layout.to_string()
}

fn status(words: &str) -> String {
    /// "warning" of the protocol: it goes on.
    const WARNING: u8 = 1;
    json!({ "op": "status", "level": WARNING, "message": words }).to_string()
}

#[cfg(test)]
mod tests;
