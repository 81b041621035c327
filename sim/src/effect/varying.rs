//! A trend in a rig file: keys of a parameter's name and a suffix.
//!
//! `f_n_along = "u"`, `f_n_from`, `f_n_to` (covariate at both ends), `f_n_without` (the number where the effect is not
//! there, 0 when not given), `f_n_share_01` … `f_n_share_40` (0 when not given).

use super::covariate_table::{COVARIATES, POINTS};
use super::{EffectError, EffectInfo, Trend};
use hydroline_rigs::ParameterValue;

/// Part of a trend that a key gives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Key {
    Along,
    From,
    To,
    Without,
    Share(usize),
}

/// A trend as it is read, key by key.
#[derive(Debug, Default)]
pub(super) struct Typed {
    parameter: Option<usize>,
    along: Option<usize>,
    ends: [Option<f64>; 2],
    without: f64,
    shares: Vec<(usize, f64)>,
}

fn key(info: &EffectInfo, name: &str) -> Option<(usize, Key)> {
    let each = info.parameters.iter().enumerate();
    each.filter_map(|(i, p)| {
        let rest = name.strip_prefix(p.name)?.strip_prefix('_')?;
        let key = match rest {
            "along" => Key::Along,
            "from" => Key::From,
            "to" => Key::To,
            "without" => Key::Without,
            _ => {
                let place: usize = rest.strip_prefix("share_")?.parse().ok()?;
                (1..=POINTS)
                    .contains(&place)
                    .then(|| Key::Share(place - 1))?
            }
        };
        Some((i, key))
    })
    .next()
}

impl Typed {
    /// Takes a key; `false` where it is none of a trend's.
    ///
    /// # Errors
    /// [`EffectError::WrongKind`].
    pub fn take(
        &mut self,
        info: &'static EffectInfo,
        name: &str,
        value: &ParameterValue,
    ) -> Result<bool, EffectError> {
        let Some((parameter, key)) = key(info, name) else {
            return Ok(false);
        };
        let known = info.parameters[parameter].name;
        let wrong = |expected: String, found: String| EffectError::WrongKind {
            effect: info.id,
            parameter: known,
            expected: format!("of {name}, {expected}"),
            found,
        };
        if self.parameter.is_some_and(|p| p != parameter) {
            return Err(wrong(
                "one number of an effect at most varies".to_owned(),
                "a second one".to_owned(),
            ));
        }
        self.parameter = Some(parameter);
        match (key, value) {
            (Key::Along, ParameterValue::Word(word)) => {
                let Some(at) = COVARIATES.iter().position(|c| c == word) else {
                    return Err(wrong(
                        format!("one of {}", COVARIATES.join(", ")),
                        format!("\"{word}\""),
                    ));
                };
                self.along = Some(at);
            }
            (Key::Along, ParameterValue::Number(v)) => {
                return Err(wrong("a covariate's name".to_owned(), v.to_string()));
            }
            (_, ParameterValue::Word(word)) => {
                return Err(wrong("a number".to_owned(), format!("\"{word}\"")));
            }
            (_, ParameterValue::Number(v)) if !v.is_finite() => {
                return Err(wrong("a finite number".to_owned(), v.to_string()));
            }
            (Key::From, ParameterValue::Number(v)) => self.ends[0] = Some(*v),
            (Key::To, ParameterValue::Number(v)) => self.ends[1] = Some(*v),
            (Key::Without, ParameterValue::Number(v)) => self.without = *v,
            (Key::Share(k), ParameterValue::Number(v)) => self.shares.push((k, *v)),
        }
        Ok(true)
    }

    /// The trend; `None` without any key.
    ///
    /// # Errors
    /// [`EffectError::WrongKind`] where the covariate or an end is missing.
    pub fn checked(self, info: &'static EffectInfo) -> Result<Option<Trend>, EffectError> {
        let Some(parameter) = self.parameter else {
            return Ok(None);
        };
        let name = info.parameters[parameter].name;
        let missing = |what: &str| EffectError::WrongKind {
            effect: info.id,
            parameter: name,
            expected: format!(
                "{name}_along, {name}_from and {name}_to (a number that varies needs all three)"
            ),
            found: format!("no {name}_{what}"),
        };
        let along = self.along.ok_or_else(|| missing("along"))?;
        let from = self.ends[0].ok_or_else(|| missing("from"))?;
        let to = self.ends[1].ok_or_else(|| missing("to"))?;
        let mut shares = vec![0.0; POINTS];
        for (k, v) in self.shares {
            shares[k] = v;
        }
        Ok(Some(Trend {
            parameter,
            nothing: self.without,
            along,
            range: (from, to),
            shares,
        }))
    }
}

pub(super) fn keys(info: &EffectInfo, trend: &Trend) -> Vec<(String, ParameterValue)> {
    let Some(p) = info.parameters.get(trend.parameter) else {
        return Vec::new();
    };
    let mut made = vec![(
        format!("{}_along", p.name),
        ParameterValue::Word(COVARIATES[trend.along].to_owned()),
    )];
    let mut number = |suffix: &str, v: f64| {
        made.push((format!("{}_{suffix}", p.name), ParameterValue::Number(v)));
    };
    number("from", trend.range.0);
    number("to", trend.range.1);
    number("without", trend.nothing);
    for (k, v) in trend.shares.iter().enumerate() {
        number(&format!("share_{:02}", k + 1), *v);
    }
    made
}

#[cfg(test)]
mod tests {
    use crate::effect::tests::fixtures::*;
    use crate::effect::{CheckedEffect, Trend, check, find};
    use hydroline_rigs::ParameterValue;

    #[test]
    fn what_is_written_reads_back() {
        let mut one = CheckedEffect::typical(find("coulomb_friction").unwrap());
        one.trend = Some(Trend {
            parameter: 0,
            nothing: 0.0,
            along: 6,
            range: (-0.3, 0.4),
            shares: (0..super::POINTS).map(|k| 0.01 * k as f64).collect(),
        });
        let back = check(&[one.entry()]).unwrap();
        assert_eq!(back[0].trend, one.trend);
        assert_eq!(back[0].numbers, one.numbers);
    }

    #[test]
    fn half_a_trend_is_an_error_that_says_what_is_missing() {
        let entry = with_word(entry("coulomb_friction", &[("f_n", 0.2)]), "f_n_along", "u");
        let said = check(std::slice::from_ref(&entry)).unwrap_err().to_string();
        assert!(said.contains("f_n_from"), "{said}");
        let mut wrong = entry;
        wrong.parameters[1].1 = ParameterValue::Word("speed".to_owned());
        let said = check(&[wrong]).unwrap_err().to_string();
        assert!(said.contains("one of x, y"), "{said}");
    }
}
