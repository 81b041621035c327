//! Frames by their times: the nearest to a moment, the one before or after another. Two or three places are read for it.

use crate::viewed::Viewed;
use hydroline_core::frame::Frame;
use hydroline_core::lock::Lock;
use hydroline_log::PlainMessage;
use std::collections::VecDeque;
use std::sync::Arc;

/// Bytes of images in the places that are kept: what is stepped through is not read again and again.
const KEPT_BYTES: usize = 48 << 20;

/// Images of one place, in the order of time.
#[derive(Debug)]
struct Shelf {
    /// Number of the image topic, and of the place among its places.
    of: (usize, usize),
    images: Vec<(i64, PlainMessage)>,
}

impl Shelf {
    fn bytes(&self) -> usize {
        self.images.iter().map(|(_, m)| m.data.len()).sum()
    }
}

/// Places that were read last.
#[derive(Debug, Default)]
pub(crate) struct Recent(VecDeque<Arc<Shelf>>);

/// Which frame is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wanted {
    /// The nearest to a moment; of two as near, the first.
    Nearest,
    /// The first behind it.
    Next,
    /// The last before it.
    Previous,
}

/// A frame and its time.
#[derive(Debug, Clone)]
pub struct Shown {
    /// When it was true, since the log's zero \[ns\].
    pub at_ns: i64,
    /// The frame, or why it does not decode.
    pub frame: Result<Frame, String>,
}

impl Viewed {
    /// A frame of an image topic by its time; `None` = there is none there.
    pub fn frame(&self, topic: usize, at_ns: i64, wanted: Wanted) -> Option<Shown> {
        let places = &self.images().get(topic)?.places;
        let all = self.log().all_places();
        let begins = |k: &usize| self.since_zero(all[*k].span_ns().0) <= at_ns;
        // A frame is logged after it was true: it is here, or further on.
        let here = places.partition_point(begins).saturating_sub(1);
        let (mut before, mut after): (Option<Found>, Option<Found>) = (None, None);
        for k in here..places.len() {
            let found = self.around(topic, k, at_ns);
            before = later(before, found.before);
            after = after.or(found.after);
            if after.is_some() {
                break;
            }
        }
        for k in (0..here).rev() {
            // One that is found here may have an earlier one after the moment in the place before.
            if before.is_some() {
                break;
            }
            let found = self.around(topic, k, at_ns);
            before = later(before, found.before);
            after = earlier(found.after, after);
        }
        let exact = |found: &Option<Found>| found.as_ref().is_some_and(|f| f.0 == at_ns);
        let chosen = match wanted {
            Wanted::Nearest => match (before, after) {
                (Some(b), Some(a)) if a.0.abs_diff(at_ns) < b.0.abs_diff(at_ns) => Some(a),
                (before, after) => before.or(after),
            },
            Wanted::Next => after,
            Wanted::Previous if exact(&before) => self.previous(topic, here, at_ns),
            Wanted::Previous => before,
        };
        let (at_ns, message) = chosen?;
        let frame = self.log().image(&message)?;
        Some(Shown { at_ns, frame })
    }

    /// The last frame before a moment, which is itself one's.
    fn previous(&self, topic: usize, here: usize, at_ns: i64) -> Option<Found> {
        let places = self.images().get(topic)?.places.len();
        // It may lie behind the place of the moment where frames were logged late.
        let last = (here + 1).min(places.saturating_sub(1));
        (0..=last).rev().find_map(|k| {
            let shelf = self.shelf(topic, k);
            let earlier = shelf.images.iter().rev().find(|(t, _)| *t < at_ns);
            earlier.cloned()
        })
    }

    fn around(&self, topic: usize, k: usize, at_ns: i64) -> Around {
        let shelf = self.shelf(topic, k);
        let behind = shelf.images.partition_point(|(t, _)| *t <= at_ns);
        Around {
            before: behind.checked_sub(1).map(|k| shelf.images[k].clone()),
            after: shelf.images.get(behind).cloned(),
        }
    }

    /// Images of a place, read now or before.
    fn shelf(&self, topic: usize, k: usize) -> Arc<Shelf> {
        let mut recent = self.recent.held();
        if let Some(shelf) = recent.0.iter().find(|s| s.of == (topic, k)) {
            return shelf.clone();
        }
        let images = self.images().get(topic);
        let place = images.and_then(|i| i.places.get(k)).copied();
        let channels: Vec<u16> = images.iter().map(|i| i.channel).collect();
        let messages = place.map(|place| self.messages(place, &channels));
        let mut images: Vec<(i64, PlainMessage)> = (messages.into_iter().flatten())
            .map(|m| (self.since_zero(self.stamp_ns(&m)), m))
            .collect();
        images.sort_by_key(|(t, _)| *t);
        let shelf = Arc::new(Shelf {
            of: (topic, k),
            images,
        });
        recent.0.push_back(shelf.clone());
        let mut bytes: usize = recent.0.iter().map(|s| s.bytes()).sum();
        // The newest always stays.
        while bytes > KEPT_BYTES && recent.0.len() > 1 {
            bytes -= recent.0.pop_front().map_or(0, |s| s.bytes());
        }
        shelf
    }
}

type Found = (i64, PlainMessage);

/// Frames of one place on either side of a moment; one at the moment is before it.
struct Around {
    before: Option<Found>,
    after: Option<Found>,
}

fn later(a: Option<Found>, b: Option<Found>) -> Option<Found> {
    a.into_iter().chain(b).max_by_key(|(t, _)| *t)
}

fn earlier(a: Option<Found>, b: Option<Found>) -> Option<Found> {
    a.into_iter().chain(b).min_by_key(|(t, _)| *t)
}
