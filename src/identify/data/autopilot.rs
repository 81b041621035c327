//! Motion by an autopilot's own instruments, beside that of the tank's.

use hydroline_log::messages::pb;

/// Adds what only the autopilot measures. A channel is of one instrument: those that `motion` has keep to it, for the
/// autopilot's place and heading are of another origin than the tank's, and its noise is another.
pub(super) fn beside(motion: &mut Vec<pb::VehicleMotion>, autopilot: Vec<pb::VehicleMotion>) {
    if autopilot.is_empty() {
        return;
    }
    let mut of_tank = [false; 12];
    for sample in motion.iter() {
        for (has, value) in of_tank.iter_mut().zip(sample.channels()) {
            *has |= value.is_some();
        }
    }
    for sample in autopilot {
        let mut values = sample.channels().into_array();
        for (value, has) in values.iter_mut().zip(of_tank) {
            *value = value.filter(|_| !has);
        }
        if values.iter().any(Option::is_some) {
            motion.push(pb::VehicleMotion {
                timestamp: sample.timestamp,
                ..pb::VehicleMotion::of(0, values.into())
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_log::messages::timestamp;

    #[test]
    fn a_channel_is_of_one_instrument() {
        let tank =
            pb::VehicleMotion::of_pose(10, [Some(1.0), Some(2.0), None, None, None, Some(0.1)]);
        let autopilot = pb::VehicleMotion {
            timestamp: Some(timestamp(13)),
            z_m: Some(0.7),
            psi_rad: Some(2.0),
            r_radps: Some(0.3),
            ..pb::VehicleMotion::default()
        };
        let only_psi = pb::VehicleMotion {
            psi_rad: Some(2.0),
            ..pb::VehicleMotion::default()
        };
        let mut motion = vec![tank.clone()];
        beside(&mut motion, vec![autopilot.clone(), only_psi]);
        assert_eq!(motion[0], tank);
        assert_eq!(
            motion.len(),
            2,
            "what the tank measures is not measured twice"
        );
        let added = pb::VehicleMotion {
            psi_rad: None,
            ..autopilot.clone()
        };
        assert_eq!(motion[1], added);
        let mut alone = Vec::new();
        beside(&mut alone, vec![autopilot.clone()]);
        assert_eq!(alone, [autopilot], "without the tank's it stands alone");
    }
}
