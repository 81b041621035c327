//! The score of variants, and what went wrong, in words.

use std::fmt::Write as _;

use super::{BEFORE, InvarianceJudged, SHIFT_SDS, Variant, Varied, is_plain};
use crate::benchmark::score::Rate;

/// Score of a variant.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct VariantScore {
    /// The variant.
    pub variant: Variant,
    /// The same verdict and effects with the same numbers.
    pub right: Rate,
    /// The same verdict and effects, whatever their numbers.
    pub same: Rate,
    /// Median of the largest shift of a case \[sd\].
    pub median_shift_sds: f64,
    /// Largest shift of all \[sd\].
    pub largest_shift_sds: f64,
}

/// Score of all variants.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct InvarianceScore {
    /// Variant by variant.
    pub variants: Vec<VariantScore>,
    /// Channels of all cases and variants in which `before` is what maximum likelihood leaves.
    pub before: Rate,
    /// Smallest and largest `before` over that.
    pub before_over_plain: [f64; 2],
}

/// Scores cases.
pub fn score(all: &[InvarianceJudged]) -> InvarianceScore {
    let of = |variant: Variant| {
        let each = all.iter().flat_map(|j| &j.varied);
        each.filter(move |v| v.variant == variant)
    };
    let scored = |variant: Variant| {
        let mut shifts: Vec<f64> = of(variant).map(|v| v.shift_sds).collect();
        shifts.sort_by(f64::total_cmp);
        let at = |place: usize| shifts.get(place).copied().unwrap_or(0.0);
        VariantScore {
            variant,
            right: Rate::of(of(variant).map(Varied::is_right)),
            same: Rate::of(of(variant).map(|v| v.is_same)),
            median_shift_sds: at(shifts.len() / 2),
            largest_shift_sds: at(shifts.len().saturating_sub(1)),
        }
    };
    let ratios = || all.iter().flat_map(InvarianceJudged::ratios).map(|r| r.2);
    let ends = ratios().fold([f64::INFINITY, 0.0_f64], |[low, high], r| {
        [low.min(r), high.max(r)]
    });
    InvarianceScore {
        variants: Variant::ALL.map(scored).to_vec(),
        before: Rate::of(ratios().map(is_plain)),
        before_over_plain: ends,
    }
}

/// Complaint about a case, in a line.
pub fn complaint(j: &InvarianceJudged) -> Option<String> {
    let mut said: Vec<String> = Vec::new();
    for v in j.varied.iter().filter(|v| !v.is_right()) {
        let name = v.variant.name();
        said.push(match v.is_same {
            false => format!("{name}: {}", v.sentence),
            true => {
                let known = v.sd_ratio.map_or(String::new(), |r| {
                    format!(" (its sd is {r:.2} of what it was)")
                });
                format!(
                    "{name}: {} shifts by {:.2} sd{known}",
                    v.shifted, v.shift_sds
                )
            }
        });
    }
    for (variant, channel, ratio) in j.ratios().filter(|r| !is_plain(r.2)) {
        let name = variant.map_or("as it is", Variant::name);
        said.push(format!(
            "{name}: before is {ratio:.3} of maximum likelihood in {channel}"
        ));
    }
    let what = said.join("; ");
    (!said.is_empty())
        .then(|| format!("invariance-{} ({}): {what} | {}", j.index, j.of, j.sentence))
}

/// The score in words.
pub fn words(all: &[InvarianceJudged]) -> String {
    let s = score(all);
    let mut made = String::new();
    let mut line = |what: &str, rate: Rate, more: &str| {
        if rate.count == 0 {
            return;
        }
        // Writing to a String cannot fail.
        let _ = writeln!(
            made,
            "{what:58} {:>5.1} % ({}/{}; {:.1}-{:.1}){more}",
            100.0 * rate.share,
            rate.hits,
            rate.count,
            100.0 * rate.low,
            100.0 * rate.high
        );
    };
    for v in &s.variants {
        let name = v.variant.name();
        let shifts = format!(
            "   shift: median {:.3}, largest {:.3} sd",
            v.median_shift_sds, v.largest_shift_sds
        );
        line(
            &format!("{name}: same verdict, numbers within {SHIFT_SDS} sd"),
            v.right,
            &shifts,
        );
        line(&format!("{name}: same verdict and effects"), v.same, "");
    }
    let [low, high] = s.before_over_plain;
    line(
        &format!(
            "before within {:.0} % of maximum likelihood",
            100.0 * BEFORE
        ),
        s.before,
        &format!("   ratios {low:.3} to {high:.3}"),
    );
    made
}

#[cfg(test)]
mod tests {
    use super::*;
    use hydroline_diagnose::verdict::Word;

    #[test]
    fn a_shift_and_a_coarse_fit_of_the_vehicle_alone_are_complained_of() {
        let varied = |variant: Variant, shift_sds: f64| Varied {
            variant,
            word: Word::None,
            sentence: String::new(),
            is_same: true,
            shift_sds,
            shifted: "x_udot".to_owned(),
            sd_ratio: Some(1.1),
            before_over_plain: [("x_m".to_owned(), 1.01)].into_iter().collect(),
        };
        let judged = |shift_sds: f64, ratio: f64| InvarianceJudged {
            index: 3,
            of: "single-3".to_owned(),
            word: Word::None,
            sentence: String::new(),
            mattering: Vec::new(),
            before_over_plain: [("x_m".to_owned(), ratio)].into_iter().collect(),
            varied: Variant::ALL.map(|v| varied(v, shift_sds)).to_vec(),
            seconds: 0.0,
        };
        let all = [judged(0.02, 1.0), judged(0.3, 1.2)];
        let s = score(&all);
        assert_eq!((s.before.hits, s.before.count), (7, 8));
        assert_eq!(s.before_over_plain, [1.0, 1.2]);
        assert!(
            s.variants
                .iter()
                .all(|v| v.right.hits == 1 && v.same.hits == 2)
        );
        assert_eq!(complaint(&all[0]), None);
        let said = complaint(&all[1]).unwrap();
        assert!(
            said.contains("x_udot shifts by 0.30 sd") && said.contains("before is 1.200"),
            "{said}"
        );
        assert!(words(&all).contains("(7/8;"));
    }
}
