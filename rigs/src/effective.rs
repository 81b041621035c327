//! Checked objects written out again: every include inlined, every default said.
//!
//! What is written reads back to the same object, bit for bit: angles in radians,
//! intrinsics as four numbers, floats in Rust's shortest exact form.

mod parts;
mod writer;

pub(crate) use parts::{board_file, plan, target_file};

use std::path::Path;

use parts::{board, target};
use writer::Writer;

use crate::raw::axis_keys;
use crate::{
    CameraBackend, Channel, DeviceIdentity, Dof, LinkKind, LinkPort, ParameterValue, Rig,
    StatedResponse, VehicleModel,
};

/// The effective rig.
pub(crate) fn rig(rig: &Rig) -> String {
    let mut w = Writer::default();
    w.table("rig");
    w.text("name", &rig.name);
    camera(&mut w, rig);
    w.table("laser");
    w.number("fan_rad", rig.laser.fan_rad);
    w.number("sigma_m", rig.laser.sigma_m);
    w.number("peak", rig.laser.peak);
    w.raw("shadows", rig.laser.shadows);
    if rig.laser.channel != Channel::Luma {
        w.text("channel", rig.laser.channel.name());
    }
    w.table("mounts");
    w.number("l_laser_m", rig.mounts.l_laser_m);
    w.number("l_camera_m", rig.mounts.l_camera_m);
    w.number("h_camera_m", rig.mounts.h_camera_m);
    w.number("h_centre_m", rig.mounts.h_centre_m);
    w.number("camera_tilt_rad", rig.mounts.camera_tilt_rad);
    if let Some(port) = &rig.port {
        w.table("port");
        w.number("distance_m", port.distance_m);
        w.number("glass_m", port.glass_m);
    }
    if let Some(t) = &rig.target {
        w.table("target");
        target(&mut w, t, "target.slab");
    }
    if let Some(b) = &rig.board {
        w.table("board");
        board(&mut w, b, "board.block");
    }
    thrusters(&mut w, rig);
    if let Some(pull) = &rig.bollard {
        w.table("bollard");
        w.number("voltage_v", pull.voltage_v);
        w.number("scatter_n", pull.scatter_n);
        w.numbers("pulse_us", &pull.pulse_us);
        w.rows("covariance_n2", &pull.covariance_n2);
    }
    vehicle(&mut w, rig);
    if let Some(known) = &rig.identified {
        w.table("identified");
        w.words("coefficients", &known.coefficients);
        w.numbers("values", &known.values);
        w.numbers("sd", &known.sd);
        w.rows("covariance", &known.covariance);
    }
    settings(&mut w, rig);
    for entry in &rig.physics {
        w.entry("physics");
        w.text("effect", &entry.effect);
        for (name, value) in &entry.parameters {
            match value {
                ParameterValue::Number(number) => w.number(name, *number),
                ParameterValue::Word(word) => w.text(name, word),
            }
        }
    }
    w.finish()
}

/// The table of a response alone.
pub(crate) fn response_table(stated: &StatedResponse) -> String {
    let mut w = Writer::default();
    response(&mut w, stated);
    w.finish()
}

fn response(w: &mut Writer, stated: &StatedResponse) {
    w.table("camera.response");
    w.number("gamma", stated.gamma);
    w.number("gamma_sd", stated.gamma_sd);
    if let Some([level, sd]) = stated.black_levels {
        w.number("black_levels", level);
        w.number("black_levels_sd", sd);
    }
    if stated.gamma_black_correlation != 0.0 {
        w.number("gamma_black_correlation", stated.gamma_black_correlation);
    }
    if let Some(level) = stated.ceiling_levels {
        w.raw("ceiling_levels", level);
    }
    w.text("source", &stated.source);
}

fn camera(w: &mut Writer, rig: &Rig) {
    let c = &rig.camera;
    w.table("camera");
    match &c.backend {
        CameraBackend::Sim => w.text("backend", "sim"),
        CameraBackend::V4l(identity) => {
            w.text("backend", "v4l");
            match identity {
                DeviceIdentity::ById(name) => w.text("device", &format!("/dev/v4l/by-id/{name}")),
                DeviceIdentity::ByPath(name) => {
                    w.text("device", &format!("/dev/v4l/by-path/{name}"));
                }
                DeviceIdentity::Node(path) => node(w, "device", path),
            }
        }
    }
    w.text("pixel_format", c.pixel_format.name());
    // Only what was said: a rig of before these keys is the same text as it was, and its logs compare as before.
    if let Some(bits) = c.bits {
        w.raw("bits", bits);
    }
    if let Some(range) = c.yuv_range {
        w.text("yuv_range", range.name());
    }
    w.raw("width_px", c.width_px);
    w.raw("height_px", c.height_px);
    w.number("rate_fps", c.rate_fps);
    w.number("exposure_s", c.exposure_s);
    w.number("fx_px", c.fx_px);
    w.number("fy_px", c.fy_px);
    w.number("cx_px", c.cx_px);
    w.number("cy_px", c.cy_px);
    w.raw("seed", c.seed);
    w.number("frozen_after_s", c.frozen_after_s);
    w.table("camera.noise");
    w.number("blur_px", c.noise.blur_px);
    w.number("read_sd", c.noise.read_sd);
    w.number("shot_gain", c.noise.shot_gain);
    w.number("ambient", c.noise.ambient);
    if let Some(stated) = &c.response {
        response(w, stated);
    }
    for control in &c.controls {
        w.entry("camera.control");
        w.text("name", &control.name);
        w.raw("value", control.value);
    }
}

fn node(w: &mut Writer, key: &str, path: &Path) {
    w.text(key, &path.display().to_string());
    w.raw("allow_unstable_node", true);
}

fn thrusters(w: &mut Writer, rig: &Rig) {
    let set = &rig.thrusters;
    w.table("thrusters");
    w.number("neutral_us", set.neutral_us);
    w.number("min_us", set.min_us);
    w.number("max_us", set.max_us);
    w.number("max_slew_us_per_s", set.max_slew_us_per_s);
    w.table("thrusters.link");
    w.text(
        "kind",
        match set.link.kind {
            LinkKind::Maestro => "maestro",
            LinkKind::Stamped => "stamped",
        },
    );
    match &set.link.port {
        LinkPort::Sim => w.text("port", "sim"),
        LinkPort::ById(name) => w.text("port", &format!("/dev/serial/by-id/{name}")),
        LinkPort::ByPath(name) => w.text("port", &format!("/dev/serial/by-path/{name}")),
        LinkPort::Node(path) => node(w, "port", path),
    }
    w.raw("baud", set.link.baud);
    w.number("rate_hz", set.link.rate_hz);
    w.number("deadline_s", set.link.deadline_s);
    w.number("timeout_s", set.link.timeout_s);
    for thruster in &set.thrusters {
        w.entry("thruster");
        w.text("name", &thruster.name);
        w.raw("channel", thruster.channel);
        w.numbers("position_m", &thruster.position_m);
        w.numbers("direction", &thruster.direction);
        let points: Vec<[f64; 2]> = thruster.curve.points.iter().map(|&(p, t)| [p, t]).collect();
        w.pairs("curve", &points);
    }
}

fn vehicle(w: &mut Writer, rig: &Rig) {
    let v = &rig.vehicle;
    w.table("vehicle");
    w.text(
        "model",
        match v.model {
            VehicleModel::Eq1 => "eq1",
            VehicleModel::Decoupled => "decoupled",
        },
    );
    w.number("mass_kg", v.mass_kg);
    w.numbers("inertia_kgm2", &v.inertia_kgm2);
    w.number("r_bz_m", v.r_bz_m);
    w.number("gravity_mps2", v.gravity_mps2);
    for dof in Dof::ALL {
        let axis = v.coefficients[dof.index()];
        w.table(&format!("vehicle.{}", dof.name()));
        for ((key, _), value) in
            axis_keys(dof)
                .into_iter()
                .zip([axis.added, axis.linear, axis.quadratic])
        {
            w.number(key, value);
        }
    }
}

fn settings(w: &mut Writer, rig: &Rig) {
    let [x, y, z, phi, theta, psi] = rig.tank.start_pose;
    w.table("tank");
    w.number("n_water", rig.tank.n_water);
    w.numbers("x_m", &rig.tank.x_m);
    w.numbers("y_m", &rig.tank.y_m);
    w.number("depth_m", rig.tank.depth_m);
    w.numbers("start_m", &[x, y, z]);
    w.numbers("start_attitude_rad", &[phi, theta, psi]);
    w.table("limits");
    w.numbers("x_m", &rig.limits.x_m);
    w.numbers("y_m", &rig.limits.y_m);
    w.numbers("z_m", &rig.limits.z_m);
    w.number("attitude_rad", rig.limits.attitude_rad);
    w.table("tolerance");
    w.number("position_m", rig.tolerance.position_m);
    w.number("attitude_rad", rig.tolerance.attitude_rad);
    w.number("speed_mps", rig.tolerance.speed_mps);
    w.number("rate_radps", rig.tolerance.rate_radps);
    w.table("log");
    w.raw("queue_bytes", rig.log.queue_bytes);
    w.raw("chunk_bytes", rig.log.chunk_bytes);
    w.number("chunk_age_s", rig.log.chunk_age_s);
    w.number("command_flush_s", rig.log.command_flush_s);
    w.number("sync_s", rig.log.sync_s);
    w.raw("rotate_bytes", rig.log.rotate_bytes);
    w.raw("min_free_bytes", rig.log.min_free_bytes);
    w.raw("zstd_level", rig.log.zstd_level);
}
