//! Tank, limits, tolerance and logging settings.

use crate::FRAME_BYTES_MAX;
use crate::channel::PerChannel;
use crate::raw::{Kind, Quantity, Section, angle, angles, interval, number, numbers, whole};

const fn length() -> Quantity {
    number(-1000.0, 1000.0, "m")
}

/// Meaning of `x_m` and `y_m`, for messages about them.
const WALLS: &str = "where the walls of the tank stand, in m";

table! {
    /// The tank, and where the vehicle starts; tank frame, z down, 0 on the floor.
    pub struct Tank: Copy as TankTyped, checked by start_in_water {
        /// Refractive index in front of the camera: 1.333 fresh water, 1.340 sea water, 1.0 = no water and no port.
        pub n_water: f64 = number(1.0, 1.6, "").or(1.0),
        /// Walls along x: from, to.
        pub x_m: [f64; 2] = interval(length(), WALLS),
        /// Walls along y: from, to.
        pub y_m: [f64; 2] = interval(length(), WALLS),
        /// Depth of the water.
        ///
        /// The surface is at z = -depth.
        pub depth_m: f64 = number(0.0, 200.0, "m").above(),
        /// Position of the CG at the start; within the water.
        key start_m: [f64; 3] = numbers(length()) => |t| t.start_pose[..3].try_into().ok(),
        /// Roll, pitch and yaw at the start.
        key start_attitude_rad: [f64; 3] = angles(number(-360.0, 360.0, "deg")).or_said([0.0; 3], "level")
            => |t| t.start_pose[3..].try_into().ok(),
        /// Start pose of the CG in the tank frame: x, y, z \[m\], phi, theta, psi \[rad\] (z = -0.83: 0.83 m above the floor).
        made start_pose: [f64; 6],
    }
}

fn start_in_water(typed: &mut TankTyped, s: &Section<'_>) {
    let (Some([x, y, z]), Some([phi, theta, psi])) = (typed.start_m, typed.start_attitude_rad)
    else {
        return;
    };
    typed.start_pose = Some([x, y, z, phi, theta, psi]);
    let (Some(x_m), Some(y_m), Some(depth_m)) = (typed.x_m, typed.y_m, typed.depth_m) else {
        return;
    };
    let inside = |value: f64, [low, high]: [f64; 2]| value > low && value < high;
    if !(inside(x, x_m) && inside(y, y_m) && inside(z, [-depth_m, 0.0])) {
        s.rule(
            "start_m",
            format!(
                "the vehicle starts at ({x}, {y}, {z}) m, outside the water: x {x_m:?}, y {y_m:?}, z [{}, 0] m",
                -depth_m
            ),
            "z points down and is 0 on the floor: 0.83 m above the floor is z = -0.83",
        );
    }
}

table! {
    /// Where the CG may go. A plan that leaves it is refused before it starts; a run that leaves it goes to neutral and ends.
    pub struct Limits: Copy as LimitsTyped {
        /// Allowed x: from, to; within the tank, the start within it.
        pub x_m: [f64; 2] = interval(length(), "").later("the tank's"),
        /// Allowed y: from, to.
        pub y_m: [f64; 2] = interval(length(), "").later("the tank's"),
        /// Allowed z: from, to.
        pub z_m: [f64; 2] = interval(length(), "").later("the tank's"),
        /// Largest size of roll and of pitch.
        pub attitude_rad: f64 = angle(number(0.0, 180.0, "deg").above()).or_deg(30.0),
    }
}

/// `[limits]`: without it the tank itself.
pub(crate) fn read_limits(s: &Section<'_>, tank: Option<&Tank>) -> Option<Limits> {
    let mut typed = LimitsTyped::read(s);
    s.finish();
    let tank = tank?;
    let walls = [tank.x_m, tank.y_m, [-tank.depth_m, 0.0]];
    let intervals = [&mut typed.x_m, &mut typed.y_m, &mut typed.z_m];
    for (i, (interval, key)) in intervals.into_iter().zip(["x_m", "y_m", "z_m"]).enumerate() {
        let Some([low, high]) = *interval else {
            if !s.has(key) {
                *interval = Some(walls[i]);
            }
            continue;
        };
        let within = [low, high];
        if low < walls[i][0] || high > walls[i][1] {
            s.rule(
                key,
                format!("{within:?} m reaches beyond the tank, {:?} m", walls[i]),
                "Limits stop a run before the vehicle meets a wall: narrow them, or correct [tank]",
            );
        }
        let start_m = tank.start_pose[i];
        if !(low..=high).contains(&start_m) {
            s.rule(
                key,
                format!("the start, {start_m} m, lies outside {within:?} m: every run would stop at once"),
                "Widen the limit or move tank.start_m",
            );
        }
    }
    typed.whole()
}

table! {
    /// Sizes (root mean square) above which a misfit is practically significant.
    pub struct Tolerance: Copy as ToleranceTyped {
        /// Of a position.
        pub position_m: f64 = number(0.0, 10.0, "m").above().or(0.002),
        /// Of an angle.
        pub attitude_rad: f64 = angle(number(0.0, 90.0, "deg").above()).or_deg(0.1),
        /// Of a speed.
        pub speed_mps: f64 = number(0.0, 10.0, "m/s").above().or(0.002),
        /// Of an angular rate.
        pub rate_radps: f64 = number(0.0, 10.0, "rad/s").above().or(0.1_f64.to_radians()),
    }
}

impl Tolerance {
    /// Of each channel: position, attitude, velocity, rate.
    pub fn channels(&self) -> PerChannel<f64> {
        PerChannel::from_fn(|c| match (c.is_rate(), c.is_angular()) {
            (false, false) => self.position_m,
            (false, true) => self.attitude_rad,
            (true, false) => self.speed_mps,
            (true, true) => self.rate_radps,
        })
    }
}

const MIB: u64 = 1 << 20;

table! {
    /// Sizes, intervals and compression of the log.
    pub struct LogSettings: Copy as LogTyped, checked by sizes {
        /// Size of the queue between capture and writer; beyond it new frames are dropped and counted.
        pub queue_bytes: u64 = whole(1 << 20, 1 << 40, "bytes").or(256 * MIB),
        /// Largest size of a chunk of the file; at most `queue_bytes`.
        pub chunk_bytes: u64 = whole(4096, FRAME_BYTES_MAX as i64, "bytes").or(MIB),
        /// Longest time for which a chunk stays open.
        pub chunk_age_s: f64 = number(0.01, 60.0, "s").or(1.0),
        /// Longest time for which a command or an event waits in an open chunk.
        pub command_flush_s: f64 = number(0.001, 60.0, "s").or(0.04),
        /// Interval between calls of fdatasync.
        pub sync_s: f64 = number(0.1, 600.0, "s").or(2.0),
        /// Size from which on the log goes on in a new file; 0 = never, else at least 16 chunks.
        pub rotate_bytes: u64 = whole(0, i64::MAX, "bytes").or(0),
        /// Room that is left on the disk: with less the log is closed and the run ends.
        pub min_free_bytes: u64 = whole(0, i64::MAX, "bytes").or(512 * MIB),
        /// Compression level of zstd; 0 = no compression.
        pub zstd_level: u32 = whole(0, 19, "").or(1),
    }
}

fn sizes(typed: &mut LogTyped, s: &Section<'_>) {
    let (Some(queue), Some(chunk), Some(rotate)) =
        (typed.queue_bytes, typed.chunk_bytes, typed.rotate_bytes)
    else {
        return;
    };
    if chunk > queue {
        s.rule(
            "chunk_bytes",
            format!("a chunk of {chunk} bytes does not fit into the queue of {queue} bytes"),
            "Enter a smaller chunk_bytes or a larger queue_bytes",
        );
    }
    // A file must hold at least its own head and a few chunks, or rotation never ends.
    if rotate != 0 && rotate < 16 * chunk {
        s.rule(
            "rotate_bytes",
            format!(
                "{rotate} bytes is less than 16 chunks, {} bytes",
                16 * chunk
            ),
            "Enter 0 (never) or a larger size",
        );
    }
}
