//! What an identification found, into a rig file: values with their covariance.

use hydroline_rigs::{Identified, Rig};

use super::outcome::Identification;
use super::parameter::{Coefficient, Term};
use super::report::significant;

/// Puts every coefficient that was determined into the rig, with its covariance into `[identified]`; what an
/// earlier identification left there of other coefficients stays. Returns a sentence for each that was not taken.
pub fn adopt(result: &Identification, rig: &mut Rig) -> Vec<String> {
    let mut kept_out = Vec::new();
    // (place in the result, which, value)
    let mut taken: Vec<(usize, Coefficient, f64)> = Vec::new();
    for (i, key) in result.order.iter().enumerate() {
        let (Some(c), Some(p)) = (Coefficient::find(key), result.parameters.get(key)) else {
            continue;
        };
        let why = if !p.excited {
            "not determined by these runs"
        } else if p.at_bound {
            "ended on its search range"
        } else if p.value > 0.0 {
            match c.term {
                Term::Added => "found positive: added mass that no hull has",
                Term::Linear | Term::Quadratic => "found positive: damping that no hull has",
            }
        } else {
            taken.push((i, c, p.value));
            continue;
        };
        kept_out.push(format!(
            "{key}: {why}; the rig keeps {}",
            significant(p.rig)
        ));
    }
    let mut known = of_others(rig, &taken);
    for (_, c, value) in &taken {
        c.put(&mut rig.vehicle, *value);
    }
    let before = known.coefficients.len();
    let cell = |i: usize, j: usize| {
        result
            .covariance
            .get(i)
            .and_then(|row| row.get(j).copied().flatten())
            .unwrap_or(0.0)
    };
    for row in &mut known.covariance {
        row.extend(std::iter::repeat_n(0.0, taken.len()));
    }
    for (i, c, value) in &taken {
        known.coefficients.push(c.key().to_owned());
        known.values.push(*value);
        known.sd.push(cell(*i, *i).sqrt());
        let own = taken.iter().map(|(j, ..)| cell(*i, *j));
        known
            .covariance
            .push(std::iter::repeat_n(0.0, before).chain(own).collect());
    }
    rig.identified = (!known.coefficients.is_empty()).then_some(known);
    kept_out
}

/// What the rig's `[identified]` says of coefficients that are not taken anew and still have the value it belongs to.
fn of_others(rig: &Rig, taken: &[(usize, Coefficient, f64)]) -> Identified {
    let old = rig.identified.clone().unwrap_or_else(|| Identified {
        coefficients: Vec::new(),
        values: Vec::new(),
        sd: Vec::new(),
        covariance: Vec::new(),
    });
    let stays: Vec<usize> = (0..old.coefficients.len())
        .filter(|i| {
            Coefficient::find(&old.coefficients[*i]).is_some_and(|c| {
                c.of_vehicle(&rig.vehicle) == old.values[*i] && taken.iter().all(|t| t.1 != c)
            })
        })
        .collect();
    let of = |list: &[f64]| stays.iter().map(|i| list[*i]).collect::<Vec<f64>>();
    Identified {
        coefficients: stays.iter().map(|i| old.coefficients[*i].clone()).collect(),
        values: of(&old.values),
        sd: of(&old.sd),
        covariance: stays.iter().map(|i| of(&old.covariance[*i])).collect(),
    }
}
