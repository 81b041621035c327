//! The camera's response as a log keeps it: found in a recording's opening, under what the rig states of it where it does,
//! fixed from there on, and used again by every replay, which then fits the same poses, bit for bit.
//!
//! An event says it when it is found; the summary repeats it, where a reader finds it at once.

use hydroline_core::event::{Event, EventKind, Severity, kind};
use hydroline_log::MetadataMap;
use hydroline_log::messages::pb;
use hydroline_pose::joint::{CameraResponse, OF_RUN};
use hydroline_pose::opening::Opening;
use serde::Serialize;

/// Kind of the event.
pub static KIND: &EventKind = &kind::CAMERA_RESPONSE;

/// Numbers of a response: names of the event's values, and behind `camera.response.` of the summary's; variances and covariances
/// go by the names of both.
const NAMES: [&str; OF_RUN] = [
    "ln_gamma",
    "black_levels",
    "line_he3",
    "line_he4",
    "line_he5",
    "line_he6",
    "line_he7",
    "line_he8",
    "line_he9",
    "line_he10",
];
const FRAMES: &str = "frames";
/// One where the rig states the camera's curve; then also what the frames alone say of it, and its sd.
const RIG_STATES: &str = "rig_states";
const FRAMES_ALONE: [&str; 2] = ["frames_ln_gamma", "frames_ln_gamma_sd"];
/// Frames alone that lie further from what the rig states than so many sds contradict it: the model's own misfit of a
/// few sds is in what they say. Nearer than this share of γ they lead to the same poses.
const CONTRADICT_SDS: f64 = 5.0;
const CONTRADICT_LEAST: f64 = 0.05;
/// No camera has a curve or a black level, and no line has more across it, beyond these: a log that states one is damaged
/// \[1, grey levels, 1\].
const LN_GAMMA_MOST: f64 = 3.0;
const BLACK_MOST_LEVELS: f64 = 255.0;
const LINE_MOST: f64 = 1.0;
/// Amount by which a covariance's determinant may be below zero, as a share of its diagonal.
const ROUNDING: f64 = 1e-9;

/// The numbers of what is held and of the lower triangle of its covariance, by name.
fn named(response: &CameraResponse) -> Vec<(String, f64)> {
    let mut all = Vec::new();
    for (i, of) in NAMES.iter().enumerate() {
        all.push(((*of).to_owned(), response.mean[i]));
        for (j, with) in NAMES.iter().enumerate().take(i + 1) {
            all.push((covariance_name(of, with), response.covariance[(i, j)]));
        }
    }
    all
}

fn covariance_name(of: &str, with: &str) -> String {
    if of == with {
        format!("{of}_variance")
    } else {
        format!("{of}_{with}_covariance")
    }
}

/// A response, and the number of frames that it was found in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Response that was found; `None` where too few frames showed it: unknown.
    pub response: Option<CameraResponse>,
    /// Frames that showed it.
    pub frames: usize,
    /// Where the rig states the camera's curve: ln γ and its sd as the frames alone say it, if they do.
    pub of_rig: Option<Option<[f64; 2]>>,
}

/// The same for a person and for JSON.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct ResponseReport {
    /// γ of g = b + 255 (L/255)^γ, and its sd.
    pub gamma: [f64; 2],
    /// b and its sd \[grey levels\]; without a curve it is one with the background.
    pub black_levels: [f64; 2],
    /// Line's transverse profile beyond a Gaussian: Hermite coefficients of orders 3 to 10 and their sds.
    pub line: [[f64; 2]; OF_RUN - 2],
    /// Whether it was found: else it is as wide as what is thought of cameras beforehand.
    pub known: bool,
    /// Frames that it was found in.
    pub frames: usize,
    /// `recording` where the log stated it, `replay` where this replay found it.
    pub found_by: &'static str,
    /// Whether γ and the black level are those of the rig; what the frames alone say against it, in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stated_by_rig: Option<Stated>,
}

/// Of a curve that the rig states.
#[derive(Debug, Clone, PartialEq, Serialize, schemars::JsonSchema)]
pub struct Stated {
    /// γ as the frames alone say it, and its sd.
    pub frames_gamma: Option<[f64; 2]>,
    /// Where they contradict the rig: in words.
    pub contradiction: Option<String>,
}

impl Found {
    /// Response to fit with: the unknown one where none was found.
    pub fn in_force(&self) -> CameraResponse {
        self.response.unwrap_or(CameraResponse::UNKNOWN)
    }

    /// For a log's summary.
    pub fn metadata(&self) -> Vec<(String, String)> {
        let entry =
            |(name, value): (String, f64)| (format!("{}.{name}", KIND.name), value.to_string());
        self.numbers().map(entry).collect()
    }

    /// Response that an opening found.
    pub fn of(opening: &Opening) -> Found {
        Found {
            response: opening.response(),
            frames: opening.frames(),
            of_rig: opening.is_stated().then(|| opening.alone()),
        }
    }

    /// Response that a log's summary states; `None` where it states none.
    pub fn of_metadata(summary: &MetadataMap) -> Option<Found> {
        Found::of_named(|name| summary.get(&format!("{}.{name}", KIND.name))?.parse().ok())
    }

    fn numbers(&self) -> impl Iterator<Item = (String, f64)> {
        let frames = [(FRAMES.to_owned(), self.frames as f64)];
        let states = self.of_rig.iter().map(|_| (RIG_STATES.to_owned(), 1.0));
        let alone = self.of_rig.into_iter().flatten().flat_map(|alone| {
            let names = FRAMES_ALONE.map(str::to_owned);
            names.into_iter().zip(alone)
        });
        let all = named(&self.in_force()).into_iter().chain(frames);
        all.chain(states).chain(alone)
    }

    /// From numbers by name; `None` where one is missing, or where no camera and no covariance is like that.
    fn of_named(number: impl Fn(&str) -> Option<f64>) -> Option<Found> {
        let mut response = CameraResponse::LINEAR;
        for (i, of) in NAMES.iter().enumerate() {
            let most = match i {
                0 => LN_GAMMA_MOST,
                1 => BLACK_MOST_LEVELS,
                _ => LINE_MOST,
            };
            response.mean[i] = number(of).filter(|n| n.abs() < most)?;
            for (j, with) in NAMES.iter().enumerate().take(i + 1) {
                let found = number(&covariance_name(of, with)).filter(|n| n.is_finite())?;
                response.covariance[(i, j)] = found;
                response.covariance[(j, i)] = found;
            }
        }
        let covariance = &response.covariance;
        let sound = (0..OF_RUN).all(|i| {
            covariance[(i, i)] >= 0.0
                && (0..i).all(|j| {
                    let most = covariance[(i, i)] * covariance[(j, j)] * (1.0 + ROUNDING);
                    covariance[(i, j)] * covariance[(i, j)] <= most
                })
        });
        let frames = number(FRAMES).filter(|n| (0.0..1e6).contains(n))?;
        let alone = || {
            let [ln_gamma, sd] = FRAMES_ALONE.map(&number);
            let sd = sd.filter(|sd| sd.is_finite() && *sd >= 0.0)?;
            Some([ln_gamma.filter(|n| n.is_finite())?, sd])
        };
        sound.then(|| Found {
            response: (response != CameraResponse::UNKNOWN).then_some(response),
            frames: frames as usize,
            of_rig: number(RIG_STATES).map(|_| alone()),
        })
    }

    /// Where the frames contradict what the rig states: in words.
    fn contradiction(&self) -> Option<String> {
        let Some([ln_gamma, sd]) = self.of_rig? else {
            return Some(format!(
                "only {} of the first frames fit under it: does the run begin over the target, and is it this camera, with \
                 the controls that it was measured with? Measure it again (hydroline flat), or take [camera.response] out of the rig",
                self.frames
            ));
        };
        let off = (ln_gamma - self.in_force().mean[0]).abs();
        (off > CONTRADICT_LEAST && off > CONTRADICT_SDS * sd).then(|| {
            format!(
                "the frames show gamma {:.3} (sd {:.3}): is it this camera, with the controls that it was measured with? \
                 Measure it again (hydroline flat), or take [camera.response] out of the rig",
                ln_gamma.exp(),
                ln_gamma.exp() * sd
            )
        })
    }

    /// The event that says it.
    pub fn event(&self, stamp_ns: u64) -> Event {
        let severity = match self.response {
            Some(_) if self.contradiction().is_none() => Severity::Info,
            _ => Severity::Warning,
        };
        let event = Event::new(stamp_ns, severity, KIND, self.to_string());
        self.numbers()
            .fold(event, |event, (name, value)| event.with(name, value))
    }

    /// Response that an event states; `None` where it is another event.
    pub fn of_event(event: &pb::Event) -> Option<Found> {
        if event.kind != KIND.name {
            return None;
        }
        Found::of_named(|name| event.values.get(name).copied())
    }

    /// For a person and for JSON.
    pub fn report(&self, found_by: &'static str) -> ResponseReport {
        let response = self.in_force();
        let sd = |k: usize| response.covariance[(k, k)].sqrt();
        let gamma = response.mean[0].exp();
        ResponseReport {
            gamma: [gamma, gamma * sd(0)],
            black_levels: [response.mean[1], sd(1)],
            line: std::array::from_fn(|k| [response.mean[2 + k], sd(2 + k)]),
            known: self.response.is_some(),
            frames: self.frames,
            found_by,
            stated_by_rig: self.of_rig.map(|alone| Stated {
                frames_gamma: alone.map(|[ln_gamma, sd]| [ln_gamma.exp(), ln_gamma.exp() * sd]),
                contradiction: self.contradiction(),
            }),
        }
    }
}

/// Words for an opening of so many frames whose estimates are those of no camera.
fn of_no_camera(frames: usize) -> String {
    format!(
        "the camera's response is unknown: {frames} of the first frames show the target, but only under a response that no camera \
         has: a sheet or a target that is not the rig's (`replay --refine` finds a sheet's tilt and thickness)"
    )
}

impl ResponseReport {
    /// Words for a response that is not known.
    pub fn unknown(&self) -> String {
        if self.frames >= CameraResponse::FRAMES_LEAST {
            return of_no_camera(self.frames);
        }
        format!(
            "the camera's response is unknown ({} of its first frames show the target): x, z and pitch are known \
             accordingly; begin runs at rest over the target",
            self.frames
        )
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
            if self.frames >= CameraResponse::FRAMES_LEAST {
                return write!(f, "{}", of_no_camera(self.frames));
            }
            return write!(
                f,
                "the camera's response is unknown: {} of the first frames show the target with all six degrees of \
                 freedom, {} are needed; x, z and pitch are known accordingly: begin at rest over the target",
                self.frames,
                CameraResponse::FRAMES_LEAST
            );
        };
        let gamma = response.mean[0].exp();
        let from = match self.of_rig {
            Some(_) => format!("as the rig states it, the line from {} frames", self.frames),
            None => format!("from {} frames", self.frames),
        };
        write!(
            f,
            "the camera's response, {from}: gamma {gamma:.4} (sd {:.4}), black level {:.1} (sd {:.1})",
            gamma * response.covariance[(0, 0)].sqrt(),
            response.mean[1],
            response.covariance[(1, 1)].sqrt(),
        )?;
        match self.contradiction() {
            Some(words) => write!(f, "; {words}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_log_keeps_of_it_has_the_same_bits() {
        let mut response = CameraResponse::UNKNOWN;
        for k in 0..OF_RUN {
            response.mean[k] = 0.1 / (k as f64 - 7.3);
            response.covariance[(k, k)] /= 3.0;
        }
        (response.covariance[(0, 3)], response.covariance[(3, 0)]) = (-1e-4 / 7.0, -1e-4 / 7.0);
        for found in [
            Found {
                response: Some(response),
                frames: 8,
                of_rig: None,
            },
            Found {
                response: None,
                frames: 0,
                of_rig: None,
            },
            Found {
                response: Some(response),
                frames: 2,
                of_rig: Some(None),
            },
            Found {
                response: Some(response),
                frames: 8,
                of_rig: Some(Some([-0.8 / 7.0, 0.01 / 3.0])),
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
