//! Numbers of messages: which fields a log's topics have, and their values message by message.

use crate::viewed::{Viewed, places_of};
use hydroline_core::lock::Lock;
use hydroline_import::recorded::MessageFields;
use hydroline_log::PlainMessage;
use std::collections::{BTreeMap, BTreeSet};

/// Messages of a channel that are looked at in one place for the fields they have.
const LOOKED_AT: usize = 64;

impl Viewed {
    /// Looks at the first, the middle and the last messages of each channel for the fields they have.
    pub(crate) fn look_for_fields(&self) {
        let mut wanted: BTreeMap<usize, Vec<u16>> = BTreeMap::new();
        for channel in self.decoders.keys() {
            let places = places_of(self.log(), &[*channel]);
            let looked_at = [0, places.len() / 2, places.len().saturating_sub(1)];
            let looked_at: BTreeSet<usize> = looked_at
                .iter()
                .filter_map(|k| places.get(*k).copied())
                .collect();
            for place in looked_at {
                wanted.entry(place).or_default().push(*channel);
            }
        }
        let mut seen: BTreeMap<(usize, u16), usize> = BTreeMap::new();
        for (place, channels) in wanted {
            let messages = self.messages(place, &channels);
            let some = messages.iter().filter(|m| {
                let n = seen.entry((place, m.channel)).or_default();
                *n += 1;
                *n <= LOOKED_AT
            });
            self.each_number(some, |_, _, _| {});
        }
    }

    /// Hands on the numbers of messages with the numbers of their fields, and the messages' times. One that does not
    /// decode is noted.
    pub(crate) fn each_number<'m>(
        &self,
        messages: impl Iterator<Item = &'m PlainMessage>,
        mut each: impl FnMut(usize, i64, f64),
    ) {
        let mut read = MessageFields::default();
        let mut layouts = Layouts::default();
        for message in messages {
            let Some(decoder) = self.decoders.get(&message.channel) else {
                continue;
            };
            if let Err(why) = read.read(decoder, &message.data) {
                let topic = self.topic(message.channel);
                self.note(format!("a message of {topic} is not decoded: {why}"));
                continue;
            }
            let at_ns = self.since_zero(self.stamp_ns(message));
            // Commands and echoes of all thrusters come on one topic.
            let mut texts = read.texts();
            let key = texts.find(|(path, _)| self.is_own && *path == "thruster");
            let key = key.map_or("", |(_, name)| name);
            let layout = layouts.of(message.channel, key);
            for (place, (path, value)) in read.numbers().enumerate() {
                let number = layout.number(place, path, || {
                    self.fields.held().number(message.channel, key, path)
                });
                if let Some(number) = number {
                    each(number, at_ns, value);
                }
            }
        }
    }
}

/// Fields of messages by their places: those of a channel and a sender have them in the same order, and a name is looked up once.
#[derive(Debug, Default)]
struct Layouts(Vec<(u16, String, Layout)>);

#[derive(Debug, Default)]
struct Layout(Vec<(String, Option<usize>)>);

impl Layouts {
    fn of(&mut self, channel: u16, key: &str) -> &mut Layout {
        let known = (self.0.iter()).position(|(c, k, _)| *c == channel && k == key);
        let place = known.unwrap_or_else(|| {
            self.0.push((channel, key.to_owned(), Layout::default()));
            self.0.len() - 1
        });
        &mut self.0[place].2
    }
}

impl Layout {
    /// Number of the field at a place, as `find` has it unless it is known.
    fn number(
        &mut self,
        place: usize,
        path: &str,
        find: impl FnOnce() -> Option<usize>,
    ) -> Option<usize> {
        if let Some((known, number)) = self.0.get(place)
            && known == path
        {
            return *number;
        }
        let number = find();
        self.0.truncate(place);
        // Behind one that was left out nothing is known.
        if self.0.len() == place {
            self.0.push((path.to_owned(), number));
        }
        number
    }
}
