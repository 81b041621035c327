//! The way back to the start, for hands that move the vehicle: where it is, what is left to do, and whether it is there.
//!
//! A state machine over measured poses and their times; no camera and no clock. [`finder`] measures them.

pub mod finder;
pub mod question;

use std::f64::consts::TAU;
use std::fmt;
use std::time::Duration;

/// Tolerance within which the start is near enough.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StartTolerance {
    /// Across the floor \[m\].
    pub position_m: f64,
    /// Of the heading \[rad\].
    pub heading_rad: f64,
}

/// Hands hold a floating vehicle to a few centimetres; plans are checked with decimetres of room \[m\].
pub const POSITION_M: f64 = 0.03;
/// At 3 deg a run of 1 m ends 5 cm beside the plan's line, of the order of [`POSITION_M`] \[deg\].
pub const HEADING_DEG: f64 = 3.0;

impl Default for StartTolerance {
    fn default() -> Self {
        Self {
            position_m: POSITION_M,
            heading_rad: HEADING_DEG.to_radians(),
        }
    }
}

/// So long within the tolerance before the vehicle counts as back: crossing the tolerance is not being there.
pub const HOLD: Duration = Duration::from_secs(1);
/// A pose older than this says nothing of a vehicle in somebody's hands.
pub const FRESH: Duration = Duration::from_secs(2);

/// x, y and heading as a frame shows them; `None` = it does not.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Seen {
    /// Along the tank \[m\].
    pub x_m: Option<f64>,
    /// Across, to starboard \[m\].
    pub y_m: Option<f64>,
    /// Heading, clockwise from above \[rad\].
    pub psi_rad: Option<f64>,
}

impl Seen {
    /// Whether anything was measured.
    pub fn anything(&self) -> bool {
        self.x_m.is_some() || self.y_m.is_some() || self.psi_rad.is_some()
    }
}

/// The way that is left, in the vehicle's own directions. What the frame does not show is absent.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Left {
    /// Forward; negative = back \[m\].
    pub forward_m: Option<f64>,
    /// To the right (starboard); negative = left \[m\].
    pub right_m: Option<f64>,
    /// Clockwise from above (right); negative = left \[rad\].
    pub turn_rad: Option<f64>,
}

impl Left {
    /// From a pose to the start. A heading that is not seen is taken to be the start's; of a place that is seen along
    /// one axis only, the other is taken to be right.
    pub fn of(start: &[f64; 6], seen: &Seen) -> Self {
        let psi = seen.psi_rad.unwrap_or(start[5]);
        let (dx, dy) = (
            seen.x_m.map(|x| start[0] - x),
            seen.y_m.map(|y| start[1] - y),
        );
        let (sin, cos) = psi.sin_cos();
        let (along, across) = (dx.unwrap_or(0.0), dy.unwrap_or(0.0));
        // Fossen 2011, Eq. 2.30: from the tank's axes to the vehicle's.
        let forward = along * cos + across * sin;
        let right = -along * sin + across * cos;
        // A direction that lies mostly along the axis that is not seen is not known.
        let lengthwise = cos.abs() > sin.abs();
        let (fore_seen, side_seen) = if lengthwise {
            (dx.is_some(), dy.is_some())
        } else {
            (dy.is_some(), dx.is_some())
        };
        Self {
            forward_m: fore_seen.then_some(forward),
            right_m: side_seen.then_some(right),
            turn_rad: seen.psi_rad.map(|psi| wrapped(start[5] - psi)),
        }
    }

    /// Whether all that is seen is within the tolerance; something must be seen of the place.
    pub fn within(&self, tolerance: &StartTolerance) -> bool {
        let place = [self.forward_m, self.right_m];
        let away_m = place.iter().flatten().fold(0.0, |r: f64, v| r.hypot(*v));
        place.iter().any(Option::is_some)
            && away_m <= tolerance.position_m
            && self
                .turn_rad
                .is_none_or(|turn| turn.abs() <= tolerance.heading_rad)
    }
}

/// An angle as the shortest way, -pi to pi \[rad\].
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    angle_rad - TAU * (angle_rad / TAU).round()
}

impl fmt::Display for Left {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let way = |value: Option<f64>, plus: &str, minus: &str| {
            value.map(|v| format!("{:.2} m {}", v.abs(), if v < 0.0 { minus } else { plus }))
        };
        let turn = self.turn_rad.map(|turn| {
            let side = if turn < 0.0 { "left" } else { "right" };
            format!("turn {:.0}\u{b0} {side}", turn.abs().to_degrees())
        });
        let parts = [
            way(self.forward_m, "forward", "back"),
            way(self.right_m, "right", "left"),
            turn,
        ];
        let parts: Vec<String> = parts.into_iter().flatten().collect();
        f.write_str(&parts.join(", "))
    }
}

/// Where the matter stands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stage {
    /// No frame of late shows where the vehicle is.
    Unseen,
    /// Not there yet.
    Away(Left),
    /// Within the tolerance, not long enough.
    Arriving(Left),
    /// Held within the tolerance for long enough.
    Back(Left),
}

/// Words where no frame of late shows the vehicle.
const UNSEEN: &str = "the vehicle is not seen over its target: bring it back by eye";

/// The state machine.
#[derive(Debug, Clone)]
pub struct Guide {
    start: [f64; 6],
    tolerance: StartTolerance,
    /// The newest pose that shows anything, and when it was true \[ns\].
    newest: Option<(u64, Seen)>,
    within_since_ns: Option<u64>,
}

impl Guide {
    /// To this start.
    pub fn new(start: [f64; 6], tolerance: StartTolerance) -> Self {
        Self {
            start,
            tolerance,
            newest: None,
            within_since_ns: None,
        }
    }

    /// A frame was looked at; times on one clock, never going back \[ns\].
    pub fn look(&mut self, at_ns: u64, seen: Seen) {
        if !seen.anything() {
            return;
        }
        self.forget(at_ns);
        self.newest = Some((at_ns, seen));
        if Left::of(&self.start, &seen).within(&self.tolerance) {
            self.within_since_ns.get_or_insert(at_ns);
        } else {
            self.within_since_ns = None;
        }
    }

    fn forget(&mut self, now_ns: u64) {
        let old = |at_ns: u64| now_ns.saturating_sub(at_ns) > FRESH.as_nanos() as u64;
        if self.newest.is_some_and(|(at_ns, _)| old(at_ns)) {
            self.newest = None;
            self.within_since_ns = None;
        }
    }

    /// Where the matter stands now.
    pub fn stage(&mut self, now_ns: u64) -> Stage {
        self.forget(now_ns);
        let Some((at_ns, seen)) = self.newest else {
            return Stage::Unseen;
        };
        let left = Left::of(&self.start, &seen);
        match self.within_since_ns {
            None => Stage::Away(left),
            // By the poses' times: a vehicle that is not looked at is not held.
            Some(since) if at_ns.saturating_sub(since) >= HOLD.as_nanos() as u64 => {
                Stage::Back(left)
            }
            Some(_) => Stage::Arriving(left),
        }
    }

    /// One line of at most 80 columns: where the vehicle is and what is left to do.
    pub fn line(&mut self, now_ns: u64) -> String {
        let stage = self.stage(now_ns);
        let Some((_, seen)) = self.newest else {
            return UNSEEN.to_owned();
        };
        let number = |v: Option<f64>, digits: usize| {
            // No minus before what rounds to nothing.
            let scale = 10f64.powi(digits as i32);
            let rounded = v.map(|v| (v * scale).round() / scale + 0.0);
            rounded.map_or_else(|| "?".to_owned(), |v| format!("{v:.digits$}"))
        };
        let place = format!(
            "x {} y {} m, {}\u{b0}",
            number(seen.x_m, 2),
            number(seen.y_m, 2),
            number(seen.psi_rad.map(f64::to_degrees), 0)
        );
        match stage {
            Stage::Unseen => UNSEEN.to_owned(),
            Stage::Away(left) => format!("{place} | go {left}"),
            Stage::Arriving(_) => format!("{place} | hold it there"),
            Stage::Back(_) => {
                format!("{place} | at the start: release, Enter when the water rests")
            }
        }
    }
}

#[cfg(test)]
mod tests;
