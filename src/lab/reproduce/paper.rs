//! The paper's own numbers: Tables 7, 10 and 11.

use crate::search::axis::AxisModel;
use hydroline_identify::parameter::PAPER_MASS_KG;

/// Table 7: ψ_S \[°\] and largest absolute position error \[mm\] at 4 and 8 N; undisturbed, with pitch, with pitch and yaw.
pub const TABLE7: [[(f64, f64); 2]; 3] = [
    [(-4.05, 1.0), (-4.08, 1.0)],
    [(-4.07, 14.6), (-4.05, 29.7)],
    [(-1.53, 15.4), (-2.36, 27.9)],
];

/// (what, X_udot, X_u, X_u|u|): Table 10, the actual parameters first.
pub const TABLE10: [(&str, [f64; 3]); 4] = [
    ("actual", [-250.0, -20.0, -200.0]),
    ("surge only", [-250.061, -20.0488, -199.512]),
    ("with pitch", [-258.120, -18.8034, -208.059]),
    ("with pitch and yaw", [-256.532, -18.9499, -212.454]),
];

/// Thrusts of Table 11 \[N\].
pub const TABLE11_THRUST_N: [f64; 3] = [4.0, 8.0, 16.0];

/// Table 11 as printed \[mm\], rows as in [`TABLE10`] without the first.
pub const TABLE11_PRINTED_MM: [[f64; 3]; 3] =
    [[0.4, 1.1, 2.1], [17.5, 17.1, 42.7], [21.7, 55.5, 80.4]];

/// One row of Table 11.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Table11Row {
    /// Condition of the row, as in Table 10.
    pub condition: String,
    /// Largest |x of these parameters - x of the actual ones| over 5 m, at 4, 8, 16 N \[mm\].
    pub error_mm: [f64; 3],
    /// The same as the paper prints it \[mm\].
    pub printed_mm: [f64; 3],
}

/// Table 11 from Table 10: Eq. 7 from rest, RK4 at 1 ms, until the actual vehicle has gone 5 m.
pub fn table11() -> Vec<Table11Row> {
    let rows = TABLE10[1..].iter().zip(TABLE11_PRINTED_MM);
    rows.map(|((condition, found), printed_mm)| Table11Row {
        condition: (*condition).to_owned(),
        error_mm: TABLE11_THRUST_N
            .map(|thrust_n| 1e3 * largest_error_m(TABLE10[0].1, *found, thrust_n, 5.0)),
        printed_mm,
    })
    .collect()
}

/// Largest distance \[m\] between two surge models under a constant thrust from rest, until the first has gone `length_m`.
pub fn largest_error_m(actual: [f64; 3], found: [f64; 3], thrust_n: f64, length_m: f64) -> f64 {
    const STEP_S: f64 = 1e-3;
    let model = |[added, linear, quadratic]: [f64; 3]| AxisModel {
        mass: PAPER_MASS_KG - added,
        linear,
        quadratic,
        restoring_nm: 0.0,
        statics: None,
    };
    let (one, two) = (model(actual), model(found));
    let (mut a, mut b) = ((0.0, 0.0), (0.0, 0.0));
    let mut largest = 0.0_f64;
    // A thrust that does not reach the end within an hour never does.
    for _ in 0..3_600_000 {
        if a.0 >= length_m {
            break;
        }
        (a, b) = (one.step(STEP_S, a, thrust_n), two.step(STEP_S, b, thrust_n));
        largest = largest.max((a.0 - b.0).abs());
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn table_11_comes_out_within_a_tenth_of_a_millimetre() {
        // The figures of theory/geometry.md, the paper's tables, RK4 at 1 ms.
        let ours = [
            [0.37, 1.05, 2.11],
            [17.49, 17.13, 42.68],
            [21.64, 55.54, 80.47],
        ];
        for (row, ours) in table11().iter().zip(ours) {
            for ((error_mm, printed_mm), ours_mm) in
                row.error_mm.iter().zip(row.printed_mm).zip(ours)
            {
                assert!((error_mm - printed_mm).abs() <= 0.1, "{row:?}");
                assert!((error_mm - ours_mm).abs() <= 0.006, "{row:?}");
            }
        }
    }
}
