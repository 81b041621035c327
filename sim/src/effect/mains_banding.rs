//! `mains_banding`: lamps flicker at twice the mains frequency, and a rolling shutter lays that over the rows.

use super::{EffectInfo, Law, Optics, ParameterInfo, Stage, Values};
use crate::real::Real;

pub(super) const INFO: EffectInfo = EffectInfo {
    id: "mains_banding",
    law: "background + levels_grey (1 + sin(4 pi mains_hz t + phase_rad)), t = frame / rate_fps + row row_time_s: bands of 1 / (2 mains_hz row_time_s) rows",
    stage: Stage::Measurement,
    order: 190,
    parameters: &[
        ParameterInfo::new(
            "levels_grey",
            "grey level",
            "half of what lies between dark and bright bands, after the exposure's own smoothing, on a linear camera",
            (0.5, 10.0),
            (0.0, 100.0),
            2.0,
        ),
        ParameterInfo::new(
            "mains_hz",
            "Hz",
            "of the mains",
            (49.8, 60.2),
            (1.0, 1000.0),
            50.0,
        )
        .or(50.0),
        ParameterInfo::new(
            "row_time_s",
            "s",
            "from one row to the next",
            (10e-6, 70e-6),
            (0.0, 1e-3),
            50e-6,
        ),
        ParameterInfo::new(
            "phase_rad",
            "rad",
            "of the flicker at the first row of frame 0",
            (-3.2, 3.2),
            (-1000.0, 1000.0),
            0.0,
        )
        .or(0.0),
    ],
    words: &[],
    confusable: &["ambient_gradient"],
    source: "CMOS sensors with an electronic rolling shutter under lamps on the mains: light follows the square of the voltage",
};

#[derive(Debug)]
struct Banding<T>([T; 4]);

pub(super) fn law<T: Real>(values: &Values<'_, T>) -> impl Law<T> + use<T> {
    Banding(std::array::from_fn(|i| values.numbers[i]))
}

impl<T: Real> Law<T> for Banding<T> {
    fn optics(&self, optics: &mut Optics<T>) {
        [
            optics.brightness.banding_grey,
            optics.brightness.mains_hz,
            optics.brightness.banding_row_s,
            optics.brightness.banding_phase_rad,
        ] = self.0;
    }
}

#[cfg(test)]
mod tests {
    use crate::effect::testing::*;

    fn banded(mains_hz: f64, frame: u64) -> Vec<u8> {
        let lamp = [
            ("levels_grey", 20.0),
            ("mains_hz", mains_hz),
            ("row_time_s", 50e-6),
            ("phase_rad", 0.5),
        ];
        Bare::quiet(30.0, &[entry("mains_banding", &lamp)]).dark_frame(frame)
    }

    #[test]
    fn bands_stand_200_rows_apart_and_drift_with_mains_against_frames() {
        // 100 Hz at 50 us a row: 200 rows.
        let image = banded(50.0, 3);
        for row in [0usize, 50, 100, 170, 333] {
            let angle = 0.5 + std::f64::consts::TAU * row as f64 / 200.0;
            let expected = 50.0 + 20.0 * angle.sin();
            for column in [0, 400, 719] {
                let seen = f64::from(image[row * 720 + column]);
                assert_eq!(seen, expected.round(), "row {row}");
            }
        }
        // At 25 frames a second 50 Hz stand still; 50.05 Hz move by 0.1 / 25 of a band from frame to frame.
        assert_eq!(banded(50.0, 0), banded(50.0, 1));
        let angle = 0.5 + std::f64::consts::TAU * (100.1 / 25.0 * 40.0);
        let first = f64::from(banded(50.05, 40)[0]);
        assert_eq!(first, (50.0 + 20.0 * angle.sin()).round());
    }
}
