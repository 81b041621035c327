use super::*;

const MANY: usize = 50_000;

fn known() -> Weighted {
    Weighted {
        probability: 1.0,
        physics: None,
        names: ["x_udot", "x_u", "x_uu"].map(String::from).to_vec(),
        values: vec![-250.0, -20.0, -200.0],
        logarithmic: vec![false; 3],
        covariance: DMatrix::from_row_slice(
            3,
            3,
            &[16.0, 2.0, -10.0, 2.0, 1.0, -4.0, -10.0, -4.0, 64.0],
        ),
    }
}

/// Mean, sd and correlations of columns.
fn moments(rows: &[Vec<f64>]) -> (Vec<f64>, Vec<f64>, Vec<Vec<f64>>) {
    let n = rows.len() as f64;
    let columns = rows[0].len();
    let mean: Vec<f64> = (0..columns)
        .map(|c| rows.iter().map(|r| r[c]).sum::<f64>() / n)
        .collect();
    let of = |a: usize, b: usize| {
        rows.iter()
            .map(|r| (r[a] - mean[a]) * (r[b] - mean[b]))
            .sum::<f64>()
            / n
    };
    let sd: Vec<f64> = (0..columns).map(|c| of(c, c).sqrt()).collect();
    let correlation = (0..columns)
        .map(|a| (0..columns).map(|b| of(a, b) / (sd[a] * sd[b])).collect())
        .collect();
    (mean, sd, correlation)
}

#[test]
fn of_many_draws_means_variances_and_correlations_are_the_stated_ones() {
    let model = known();
    let rows: Vec<Vec<f64>> = drawn(std::slice::from_ref(&model), MANY, 3)
        .into_iter()
        .map(|d| d.values)
        .collect();
    let (mean, sd, correlation) = moments(&rows);
    let stated: Vec<f64> = (0..3).map(|i| model.covariance[(i, i)].sqrt()).collect();
    for i in 0..3 {
        assert!(
            (mean[i] - model.values[i]).abs() < 0.03 * stated[i],
            "{i}: {}",
            mean[i]
        );
        assert!(
            (sd[i].powi(2) / stated[i].powi(2) - 1.0).abs() < 0.03,
            "{i}: {}",
            sd[i]
        );
        for j in 0..3 {
            let expected = model.covariance[(i, j)] / (stated[i] * stated[j]);
            assert!((correlation[i][j] - expected).abs() < 0.03, "{i} {j}");
        }
    }
}

#[test]
fn models_are_drawn_by_their_probabilities_and_logarithms_are_normal() {
    let lag = Weighted {
        probability: 0.3,
        physics: Some(vec![PhysicsEntry {
            effect: "thruster_lag".into(),
            parameters: vec![
                ("lag_s".into(), ParameterValue::Number(0.2)),
                ("dof".into(), ParameterValue::Word("surge".into())),
            ],
        }]),
        names: vec!["x_u".into(), "1.lag_s".into()],
        values: vec![-18.0, 0.2],
        logarithmic: vec![true, true],
        covariance: DMatrix::from_row_slice(2, 2, &[0.04, 0.0, 0.0, 0.09]),
    };
    let first = Weighted {
        probability: 0.7,
        ..known()
    };
    let models = [first, lag];
    let made = drawn(&models, MANY, 1);
    let table = table(&models, &made);
    assert_eq!(
        table.names,
        ["x_udot", "x_u", "x_uu", "thruster_lag_surge.lag_s"]
    );
    let second: Vec<&Vec<f64>> = table
        .rows
        .iter()
        .zip(&table.models)
        .filter(|r| *r.1 == 1)
        .map(|r| r.0)
        .collect();
    let share = second.len() as f64 / MANY as f64;
    assert!((share - 0.3).abs() < 0.01, "{share}");
    assert!(
        second
            .iter()
            .all(|r| r[0].is_nan() && r[1] < 0.0 && r[3] > 0.0)
    );
    let logs: Vec<Vec<f64>> = second.iter().map(|r| vec![r[3].ln()]).collect();
    let (mean, sd, _) = moments(&logs);
    assert!((mean[0] - 0.2f64.ln()).abs() < 0.01 && (sd[0] / 0.3 - 1.0).abs() < 0.02);
    // The rig of a draw has its effect and its numbers.
    let place = made.iter().position(|d| d.model == 1).unwrap();
    let rig = applied(
        &Rig::builtin("lshpi").unwrap(),
        &models,
        &made[place],
        place,
        1,
    )
    .unwrap();
    assert_eq!(rig.vehicle.coefficients[0].linear, made[place].values[0]);
    assert_eq!(
        rig.physics[0].parameters[0].1,
        ParameterValue::Number(made[place].values[1])
    );
    assert!(Rig::from_toml(&rig.effective_toml, "draw.toml", None).is_ok());
}

#[test]
fn a_seed_gives_the_same_draws_however_many_are_made() {
    let models = [known()];
    let (few, many) = (drawn(&models, 5, 9), drawn(&models, 50, 9));
    assert_eq!(few[..], many[..5]);
    assert_ne!(few, drawn(&models, 5, 10));
}

#[test]
fn what_cannot_be_drawn_from_is_refused_with_the_next_step() {
    let rig = Rig::builtin("lshpi").unwrap();
    let words = of_rig(&rig).unwrap_err().to_string();
    assert!(words.contains("--write-rig"), "{words}");
    for (text, word) in [
        ("x", "no JSON"),
        (r#"{"verdict":"none"}"#, "posterior"),
        (r#"{"verdict":"none","posterior":[]}"#, "no model"),
        (
            r#"{"verdict":"none","posterior":[{"probability":1,"physics":"","numbers":["x_u"],"values":[],"logarithmic":[],"covariance":[]}]}"#,
            "1 numbers",
        ),
        (
            r#"{"verdict":"none","posterior":[{"probability":1,"physics":"[[physics]]\nlag_s = 1","numbers":[],"values":[],"logarithmic":[],"covariance":[]}]}"#,
            "names no effect",
        ),
    ] {
        let words = of_json(text, "d.json").unwrap_err().to_string();
        assert!(
            words.contains(word) && words.contains("diagnose --json"),
            "{words}"
        );
    }
    // Damping that drives is no rig.
    let mut wide = known();
    wide.covariance *= 1e6;
    let models = [wide];
    let made = drawn(&models, 20, 1);
    let refused = made
        .iter()
        .enumerate()
        .find_map(|(k, d)| applied(&rig, &models, d, k, 1).err());
    let words = refused.unwrap().to_string();
    assert!(words.contains("take another draw"), "{words}");
    let each = made.iter().enumerate();
    let count = each.filter(|(k, d)| applied(&rig, &models, d, *k, 1).is_err());
    assert_eq!(super::refused(&rig, &models, &made), count.count());
    // A lag below 0 is named by the effect that refuses it.
    let lag = Weighted {
        physics: Some(vec![PhysicsEntry {
            effect: "thruster_lag".into(),
            parameters: vec![
                ("lag_s".into(), ParameterValue::Number(0.2)),
                ("dof".into(), ParameterValue::Word("surge".into())),
            ],
        }]),
        names: vec!["1.lag_s".into()],
        values: vec![-0.5],
        logarithmic: vec![false],
        covariance: DMatrix::zeros(1, 1),
        ..known()
    };
    let words = applied(
        &rig,
        std::slice::from_ref(&lag),
        &drawn(std::slice::from_ref(&lag), 1, 1)[0],
        7,
        1,
    )
    .unwrap_err()
    .to_string();
    assert!(
        words.contains("draw 7") && words.contains("lag_s"),
        "{words}"
    );
    assert!(!words.contains("NaN"), "{words}");
}
