//! A rig file as typed.

use super::camera::read_camera;
use super::include::{read_rig_board, read_rig_target};
use super::laser::{read_laser, read_mounts, read_port};
use super::physics::read_physics;
use super::settings::{read_limits, read_log, read_tank, read_tolerance};
use super::thruster::{read_bollard, read_thrusters};
use super::vehicle::{read_identified, read_vehicle};
use super::{Includes, Section};
use crate::Rig;

/// Reads every table of a rig file; whatever is wrong anywhere is reported.
pub(crate) fn read_rig(root: &Section<'_>, includes: &Includes) -> Option<Rig> {
    let head = root.table("rig");
    let name = head.name("name");
    head.finish();
    let camera_table = root.table("camera");
    let camera = read_camera(&camera_table);
    camera_table.finish();
    let laser = read_laser(
        &root.table("laser"),
        camera.as_ref().map(|camera| camera.pixel_format),
    );
    let mounts = read_mounts(&root.table("mounts"));
    let port = read_port(root);
    let target = read_rig_target(root, includes);
    let board = read_rig_board(root, includes);
    let thrusters = read_thrusters(root);
    let bollard = read_bollard(root);
    let vehicle = read_vehicle(&root.table("vehicle"));
    let identified = read_identified(root);
    let tank = read_tank(&root.table("tank"));
    let limits = read_limits(&root.table_or_default("limits"), tank.as_ref());
    let physics = read_physics(root);
    let tolerance = read_tolerance(&root.table_or_default("tolerance"));
    let log = read_log(&root.table_or_default("log"));
    Some(Rig {
        name: name?,
        camera: camera?,
        laser: laser?,
        mounts: mounts?,
        port: port?,
        target: target?,
        board: board?,
        thrusters: thrusters?,
        bollard: bollard?,
        vehicle: vehicle?,
        identified: identified?,
        tank: tank?,
        limits: limits?,
        physics: physics?,
        tolerance: tolerance?,
        log: log?,
        effective_toml: String::new(),
    })
}
