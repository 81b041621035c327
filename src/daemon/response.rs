//! The camera's response as a log keeps it: found in a recording's opening, fixed from there on, and used again by every
//! replay, which then fits the same poses, bit for bit.
//!
//! An event says it when it is found; the summary repeats it, where a reader finds it at once.

use hydroline_core::event::{Event, Severity};
use hydroline_log::MetadataMap;
use hydroline_log::messages::pb;
use hydroline_pose::joint::CameraResponse;
use hydroline_pose::opening::Opening;
use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

/// Kind of the event.
pub const KIND: &str = "camera.response";

/// Names of the numbers: of the event's values, and behind `camera.response.` of the summary's.
const NAMES: [&str; 5] = [
    "ln_gamma",
    "black_levels",
    "ln_gamma_variance",
    "ln_gamma_black_covariance",
    "black_variance",
];
const FRAMES: &str = "frames";
/// No camera has a curve or a black level beyond these: a log that states one is damaged \[1, grey levels\].
const LN_GAMMA_MOST: f64 = 3.0;
const BLACK_MOST_LEVELS: f64 = 255.0;
/// What a covariance's determinant may be below zero by, as a share of its diagonal.
const ROUNDING: f64 = 1e-9;

/// A response, and the number of frames that it was found in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// What was found; `None` where too few frames showed it: unknown.
    pub response: Option<CameraResponse>,
    /// Frames that showed it.
    pub frames: usize,
}

/// The same for a person and for JSON.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ResponseReport {
    /// γ of g = b + 255 (L/255)^γ, and its sd.
    pub gamma: [f64; 2],
    /// b and its sd \[grey levels\]; without a curve it is one with the background.
    pub black_levels: [f64; 2],
    /// Whether it was found: else it is as wide as what is thought of cameras beforehand.
    pub known: bool,
    /// Frames that it was found in.
    pub frames: usize,
    /// `recording` where the log stated it, `replay` where this replay found it.
    pub found_by: &'static str,
}

impl Found {
    fn numbers(&self) -> [f64; 5] {
        let CameraResponse { mean, covariance } = self.in_force();
        [
            mean[0],
            mean[1],
            covariance[(0, 0)],
            covariance[(0, 1)],
            covariance[(1, 1)],
        ]
    }

    fn of_numbers([tone, black, tone2, both, black2]: [f64; 5], frames: f64) -> Found {
        let response = CameraResponse {
            mean: Vector2::new(tone, black),
            covariance: Matrix2::new(tone2, both, both, black2),
        };
        Found {
            response: (response != CameraResponse::UNKNOWN).then_some(response),
            frames: frames as usize,
        }
    }

    /// What to fit with.
    pub fn in_force(&self) -> CameraResponse {
        self.response.unwrap_or(CameraResponse::UNKNOWN)
    }

    /// For a log's summary.
    pub fn metadata(&self) -> Vec<(String, String)> {
        let numbers = NAMES.into_iter().zip(self.numbers());
        let with_frames = numbers.chain([(FRAMES, self.frames as f64)]);
        let entry = |(name, value): (&str, f64)| (format!("{KIND}.{name}"), value.to_string());
        with_frames.map(entry).collect()
    }

    /// What an opening found.
    pub fn of(opening: &Opening) -> Found {
        Found {
            response: opening.response(),
            frames: opening.frames(),
        }
    }

    /// What a log's summary says; `None` where it says nothing.
    pub fn of_metadata(summary: &MetadataMap) -> Option<Found> {
        Found::of_named(|name| summary.get(&format!("{KIND}.{name}"))?.parse().ok())
    }

    /// From numbers by name; `None` where one is missing, or where no camera and no covariance is like that.
    fn of_named(number: impl Fn(&str) -> Option<f64>) -> Option<Found> {
        let mut numbers = [0.0; 5];
        for (to, name) in numbers.iter_mut().zip(NAMES) {
            *to = number(name)?;
        }
        let [tone, black, tone2, both, black2] = numbers;
        let sound = numbers.iter().all(|n| n.is_finite())
            && tone.abs() < LN_GAMMA_MOST
            && black.abs() < BLACK_MOST_LEVELS
            && tone2 >= 0.0
            && black2 >= 0.0
            && both * both <= tone2 * black2 * (1.0 + ROUNDING);
        let frames = number(FRAMES).filter(|n| (0.0..1e6).contains(n))?;
        sound.then(|| Found::of_numbers(numbers, frames))
    }

    /// The event that says it.
    pub fn event(&self, stamp_ns: u64) -> Event {
        let severity = match self.response {
            Some(_) => Severity::Info,
            None => Severity::Warning,
        };
        let event = Event::new(stamp_ns, severity, KIND, self.to_string());
        NAMES
            .into_iter()
            .zip(self.numbers())
            .chain([(FRAMES, self.frames as f64)])
            .fold(event, |event, (name, value)| event.with(name, value))
    }

    /// What an event says; `None` where it is another one.
    pub fn of_event(event: &pb::Event) -> Option<Found> {
        if event.kind != KIND {
            return None;
        }
        Found::of_named(|name| event.values.get(name).copied())
    }

    /// For a person and for JSON.
    pub fn report(&self, found_by: &'static str) -> ResponseReport {
        let [tone, black, tone2, _, black2] = self.numbers();
        let gamma = tone.exp();
        ResponseReport {
            gamma: [gamma, gamma * tone2.sqrt()],
            black_levels: [black, black2.sqrt()],
            known: self.response.is_some(),
            frames: self.frames,
            found_by,
        }
    }
}

impl Serialize for Found {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.report("recording").serialize(serializer)
    }
}

impl std::fmt::Display for Found {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Some(response) = self.response else {
            return write!(
                f,
                "the camera's response is unknown: {} of the first frames show the target with all six degrees of \
                 freedom, {} are needed; x, z and pitch are known accordingly: begin at rest over the target",
                self.frames,
                CameraResponse::FRAMES_LEAST
            );
        };
        let gamma = response.mean[0].exp();
        write!(
            f,
            "the camera's response, from {} frames: gamma {gamma:.4} (sd {:.4}), black level {:.1} (sd {:.1})",
            self.frames,
            gamma * response.covariance[(0, 0)].sqrt(),
            response.mean[1],
            response.covariance[(1, 1)].sqrt(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_log_keeps_of_it_has_the_same_bits() {
        let response = CameraResponse {
            mean: Vector2::new(-0.1f64.sqrt(), 1.0 / 3.0),
            covariance: Matrix2::new(2e-5 / 3.0, -1e-7, -1e-7, 0.7),
        };
        for found in [
            Found {
                response: Some(response),
                frames: 8,
            },
            Found {
                response: None,
                frames: 0,
            },
        ] {
            let summary: MetadataMap = found.metadata().into_iter().collect();
            assert_eq!(Found::of_metadata(&summary), Some(found));
            let message = hydroline_log::messages::event_message(&found.event(1));
            assert_eq!(Found::of_event(&message), Some(found));
        }
        assert_eq!(Found::of_metadata(&MetadataMap::new()), None);
    }
}
