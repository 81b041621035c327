//! `[tank]`, `[limits]`, `[tolerance]` and `[log]` as typed.

use super::{Section, quantity};
use crate::{Limits, LogSettings, Tank, Tolerance};

pub(super) fn read_tank(s: &Section<'_>) -> Option<Tank> {
    let length = quantity(-1000.0, 1000.0, "m");
    let n_water = s.number_or("n_water", quantity(1.0, 1.6, ""), 1.0);
    let wall = |key: &str| {
        s.requires(key);
        let interval = s.interval_opt(key, length);
        if interval.is_none() && !s.has(key) {
            s.missing(
                key,
                format!("`{key} = [from, to]`, where the walls of the tank stand, in m"),
            );
        }
        interval
    };
    let x_m = wall("x_m");
    let y_m = wall("y_m");
    let depth_m = s.number("depth_m", quantity(0.0, 200.0, "m").above());
    let start_m: Option<[f64; 3]> = s.numbers("start_m", length);
    let attitude = read_attitude(s);
    s.finish();
    let ([x, y, z], [phi, theta, psi]) = (start_m?, attitude?);
    let tank = Tank {
        n_water,
        start_pose: [x, y, z, phi, theta, psi],
        x_m: x_m?,
        y_m: y_m?,
        depth_m: depth_m?,
    };
    let inside = |value: f64, [low, high]: [f64; 2]| value > low && value < high;
    if !(inside(x, tank.x_m) && inside(y, tank.y_m) && inside(z, [-tank.depth_m, 0.0])) {
        s.rule(
            "start_m",
            format!(
                "the vehicle starts at ({x}, {y}, {z}) m, outside the water: x {:?}, y {:?}, z [{}, 0] m",
                tank.x_m, tank.y_m, -tank.depth_m
            ),
            "z points down and is 0 on the floor: 0.83 m above the floor is z = -0.83",
        );
    }
    Some(tank)
}

/// `start_attitude_deg` or `start_attitude_rad`: roll, pitch, yaw; level when omitted.
fn read_attitude(s: &Section<'_>) -> Option<[f64; 3]> {
    let allowed = quantity(-360.0, 360.0, "deg");
    let (rad, deg) = ("start_attitude_rad", "start_attitude_deg");
    s.asks_number(rad, "3 numbers", &allowed.deg_to_rad());
    s.asks_number(deg, "3 numbers", &allowed);
    s.default_is(deg, "level");
    if s.has(rad) && s.has(deg) {
        s.item(rad);
        s.item(deg);
        s.rule(
            deg,
            format!("{rad} and {deg} are both given"),
            "Keep one of the two",
        );
        return None;
    }
    if s.has(deg) {
        s.item(rad);
        let angles: Option<[f64; 3]> = s.numbers_opt(deg, allowed);
        return angles.map(|a| a.map(f64::to_radians));
    }
    s.item(deg);
    if s.has(rad) {
        return s.numbers_opt(rad, allowed.deg_to_rad());
    }
    s.item(rad);
    Some([0.0; 3])
}

/// Largest roll and pitch where the rig says none.
const ATTITUDE_DEG: f64 = 30.0;

/// Where a run is stopped. Without `[limits]`: the tank itself and 30 deg.
pub(super) fn read_limits(s: &Section<'_>, tank: Option<&Tank>) -> Option<Limits> {
    let length = quantity(-1000.0, 1000.0, "m");
    let keys = ["x_m", "y_m", "z_m"];
    let typed = keys.map(|key| (s.interval_opt(key, length), s.has(key)));
    let attitude_typed = s.angle_opt("attitude", quantity(0.0, 180.0, "deg").above());
    let attitude_sound =
        attitude_typed.is_some() || !(s.has("attitude_rad") || s.has("attitude_deg"));
    keys.iter().for_each(|key| s.default_is(key, "the tank's"));
    s.default_is("attitude_deg", ATTITUDE_DEG);
    s.finish();
    let tank = tank?;
    let walls = [tank.x_m, tank.y_m, [-tank.depth_m, 0.0]];
    let mut intervals = walls;
    for (i, (interval, was_typed)) in typed.into_iter().enumerate() {
        match interval {
            Some(interval) => {
                let [low, high] = interval;
                if low < walls[i][0] || high > walls[i][1] {
                    s.rule(
                        keys[i],
                        format!("{interval:?} m reaches beyond the tank, {:?} m", walls[i]),
                        "Limits stop a run before the vehicle meets a wall: narrow them, or correct [tank]",
                    );
                }
                if !(low..=high).contains(&tank.start_pose[i]) {
                    s.rule(
                        keys[i],
                        format!("the start, {} m, lies outside {interval:?} m: every run would stop at once", tank.start_pose[i]),
                        "Widen the limit or move tank.start_m",
                    );
                }
                intervals[i] = interval;
            }
            None if was_typed => return None,
            None => {}
        }
    }
    attitude_sound.then_some(())?;
    Some(Limits {
        x_m: intervals[0],
        y_m: intervals[1],
        z_m: intervals[2],
        attitude_rad: attitude_typed.unwrap_or(ATTITUDE_DEG.to_radians()),
    })
}

pub(super) fn read_tolerance(s: &Section<'_>) -> Option<Tolerance> {
    let position_m = s.number_or("position_m", quantity(0.0, 10.0, "m").above(), 0.002);
    let attitude_rad = s.angle_or("attitude", quantity(0.0, 90.0, "deg").above(), 0.1);
    let speed_mps = s.number_or("speed_mps", quantity(0.0, 10.0, "m/s").above(), 0.002);
    let rate_radps = s.number_or(
        "rate_radps",
        quantity(0.0, 10.0, "rad/s").above(),
        0.1_f64.to_radians(),
    );
    s.finish();
    Some(Tolerance {
        position_m,
        attitude_rad,
        speed_mps,
        rate_radps,
    })
}

pub(super) fn read_log(s: &Section<'_>) -> Option<LogSettings> {
    const MIB: i64 = 1 << 20;
    let bytes = |key: &str, min: i64, max: i64, default: i64| {
        s.integer_or(key, [min, max], "bytes", default) as u64
    };
    let log = LogSettings {
        queue_bytes: bytes("queue_bytes", MIB, 1 << 40, 256 * MIB),
        chunk_bytes: bytes("chunk_bytes", 4096, 64 * MIB, MIB),
        chunk_age_s: s.number_or("chunk_age_s", quantity(0.01, 60.0, "s"), 1.0),
        command_flush_s: s.number_or("command_flush_s", quantity(0.001, 60.0, "s"), 0.04),
        sync_s: s.number_or("sync_s", quantity(0.1, 600.0, "s"), 2.0),
        rotate_bytes: bytes("rotate_bytes", 0, i64::MAX, 0),
        min_free_bytes: bytes("min_free_bytes", 0, i64::MAX, 512 * MIB),
        zstd_level: s.integer_or("zstd_level", [0, 19], "", 1) as u32,
    };
    s.finish();
    if log.chunk_bytes > log.queue_bytes {
        s.rule(
            "chunk_bytes",
            format!(
                "a chunk of {} bytes does not fit into the queue of {} bytes",
                log.chunk_bytes, log.queue_bytes
            ),
            "Enter a smaller chunk_bytes or a larger queue_bytes",
        );
    }
    // A file must hold at least its own head and a few chunks, or rotation never ends.
    if log.rotate_bytes != 0 && log.rotate_bytes < 16 * log.chunk_bytes {
        s.rule(
            "rotate_bytes",
            format!(
                "{} bytes is less than 16 chunks, {} bytes",
                log.rotate_bytes,
                16 * log.chunk_bytes
            ),
            "Enter 0 (never) or a larger size",
        );
    }
    Some(log)
}
