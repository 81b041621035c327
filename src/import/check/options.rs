//! Options of the checks: every threshold of kinematics, jumps and single channels, with its reason.

use super::STUCK_ROWS;

/// Thresholds of the checks. What is a share, a gain, a correlation or a multiple has no unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Rows that are enough to say whether two channels agree; of longer tables every so many spans are compared.
    pub compared_rows: usize,
    /// Slower than this velocities are not held against positions: currents and drift are as fast.
    pub compared_speed_mps: f64,
    /// Gains that pass, from and to: calibrations differ, units by more.
    pub gains: [f64; 2],
    /// The same of two values that stand still, which a bias or a current may be part of.
    pub gains_steady: [f64; 2],
    /// A correlation from which on a sign or a unit can be determined.
    pub follows_correlation: f64,
    /// A correlation below which nothing follows.
    pub apart_correlation: f64,
    /// A rate that is another channel's follows that one so well,
    pub swapped_correlation: f64,
    /// and better than its own by so much.
    pub better_correlation: f64,
    /// Share of the way's mean square that velocities are away if they are nothing like it.
    pub away_share: f64,
    /// Largest ratio of the mean square that the right frame leaves to that by which the wrong one is away.
    pub closer_share: f64,
    /// Share that velocities in the wrong frame are away at least: a heading that is off by 8 degrees makes as much.
    pub away_least_share: f64,
    /// A variance that is so many times the noise's is motion.
    pub moves_variances: f64,
    /// A rate that moves while the pose does not must do so by more: its noise is no white one.
    pub moves_alone_variances: f64,
    /// Motion that is so many times the noise's variance needs no longer spans.
    pub clear_variances: f64,
    /// So many spans tell something.
    pub spans: usize,
    /// A correlation of so many of its own standard deviations is no chance.
    pub no_chance_sds: f64,
    /// A hole of more than so many of a channel's usual steps is not bridged.
    pub bridged_steps: f64,

    /// Rows of a channel that are looked at for jumps: fewer tell nothing of what is usual.
    pub jump_rows: usize,
    /// A jump is this many times what nineteen of twenty rows do.
    pub jump_curvatures: f64,
    /// Nineteen of twenty rows do no more than this many times what three of four do (1.7 under normal noise): what is beyond
    /// are jumps, and none of what is usual.
    pub body_curvatures: f64,
    /// No vehicle is pushed harder \[m/s²\]: twenty times its weight.
    pub push_max_mps2: f64,
    /// A vehicle's own means push it with less than its weight \[m/s²\],
    pub push_sudden_mps2: f64,
    /// and turn it less than such a force half a metre off would \[rad/s²\].
    pub turn_sudden_radps2: f64,
    /// Rows within which a lost channel returns after a jump; one that does not has moved.
    pub away_rows: usize,
    /// Share of a jump that what comes back does so by at once.
    pub back_share: f64,
    /// An angle's jump that is worth looking at \[rad\]: smaller ones are waves and noise.
    pub angle_jump_rad: f64,
    /// Steps on one side that tell how the channel goes on there.
    pub beside_steps: usize,
    /// Rows on one side that have to be quiet about a sudden jump,
    pub quiet_rows: usize,
    /// which is so many times what they do.
    pub quiet_curvatures: f64,
    /// Equal rows before a jump that look like a measurement that had stopped.
    pub frozen_rows: usize,
    /// A step of so many usual ones is a gap.
    pub gap_steps: f64,
    /// A step of less than this share of the usual one is a stamp that came late.
    pub late_share: f64,
    /// Zeros are a lost body's if they are so many of the steps beside them away.
    pub zero_steps: f64,
    /// Rows beside a group of zeros that tell these steps.
    pub zero_rows: usize,

    /// Faster than any vehicle of this kind: perhaps another unit \[m/s\].
    pub speed_max_mps: f64,
    /// Faster than anything that is thrown or falls indoors, and the crawl of a vehicle in millimetres: another unit \[m/s\].
    pub speed_unit_mps: f64,
    /// Faster than any vehicle of this kind turns, or is turned by hand: of an angle another unit, of a rate perhaps \[rad/s\].
    pub rate_max_radps: f64,
    /// A rate of six turns a second, and a slow turn in degrees: another unit \[rad/s\].
    pub rate_unit_radps: f64,
    /// A heading that goes on over several turns does so no faster \[rad/s\]: a turn in two seconds.
    pub turning_max_radps: f64,
    /// Share of a heading's range that lies between its ends if it turns one way.
    pub one_way_share: f64,
    /// Equal rows that a moving channel does not have.
    pub stuck_rows: usize,
}

impl Default for Options {
    fn default() -> Self {
        Options {
            compared_rows: 20_000,
            compared_speed_mps: 0.05,
            gains: [0.8, 1.25],
            gains_steady: [0.5, 2.0],
            follows_correlation: 0.5,
            apart_correlation: 0.3,
            swapped_correlation: 0.7,
            better_correlation: 0.3,
            away_share: 0.3,
            closer_share: 0.25,
            away_least_share: 0.02,
            moves_variances: 10.0,
            moves_alone_variances: 100.0,
            clear_variances: 100.0,
            spans: 12,
            no_chance_sds: 4.0,
            bridged_steps: 4.0,
            jump_rows: 20,
            jump_curvatures: 12.0,
            body_curvatures: 4.0,
            push_max_mps2: 200.0,
            push_sudden_mps2: 10.0,
            turn_sudden_radps2: 20.0,
            away_rows: 50,
            back_share: 0.5,
            angle_jump_rad: 0.3,
            beside_steps: 4,
            quiet_rows: 6,
            quiet_curvatures: 4.0,
            frozen_rows: 5,
            gap_steps: 3.0,
            late_share: 0.3,
            zero_steps: 4.0,
            zero_rows: 6,
            speed_max_mps: 15.0,
            speed_unit_mps: 40.0,
            rate_max_radps: 12.0,
            rate_unit_radps: 40.0,
            turning_max_radps: 3.0,
            one_way_share: 0.8,
            stuck_rows: STUCK_ROWS,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{jumps, kinematics};
    use super::*;
    use crate::table::Imported;

    /// Surge at 10 Hz that speeds up and slows down; from row 60 on `aside` further, with `gain` times its own speed.
    fn surge(aside: f64, gain: f64) -> Imported {
        let mut data = Imported::default();
        for k in 0..120 {
            let t_s = 0.1 * f64::from(k);
            data.times_s.push(t_s);
            data.lines.push(k as u64 + 2);
            let off = if k >= 60 { aside } else { 0.0 };
            data.motion[0].push(0.3 * t_s - 0.2 * t_s.cos() + off);
            data.motion[6].push(gain * (0.3 + 0.2 * t_s.sin()));
        }
        data
    }

    fn jumps(options: &Options) -> Vec<&'static str> {
        let found = jumps::check(0, f64::NAN, &surge(5.0, 1.0), options);
        found.findings.iter().map(|f| f.kind).collect()
    }

    fn rates(options: &Options) -> Vec<&'static str> {
        let mut found = Vec::new();
        let data = surge(0.0, 1.5);
        kinematics::check(&data, kinematics::Assumed::default(), options, &mut found);
        found.iter().map(|f| f.kind).collect()
    }

    #[test]
    fn thresholds_are_those_that_are_given() {
        let usual = Options::default();
        assert_eq!(jumps(&usual), ["teleport"]);
        let fast = Options {
            speed_max_mps: 1e3,
            push_max_mps2: 1e6,
            ..usual
        };
        assert_eq!(jumps(&fast), ["sudden_jump"]);
        let blind = Options {
            jump_curvatures: 1e6,
            ..usual
        };
        assert!(jumps(&blind).is_empty());
        assert_eq!(rates(&usual), ["units"]);
        let wide = Options {
            gains: [0.5, 2.0],
            ..usual
        };
        assert_eq!(rates(&wide), ["kinematics"]);
    }
}
