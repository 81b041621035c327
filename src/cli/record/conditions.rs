//! What the person at the tank says of a session.

use super::{Args, CliError, Conditions, inputs};

/// Longest value of a free key \[bytes\]: a note, not a file.
const VALUE_BYTES: usize = 4096;

/// `KEY=VALUE` of `--set`.
pub(super) fn key_value(text: &str) -> Result<(String, String), String> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| format!("'{text}' has no '=': KEY=VALUE"))?;
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "._".contains(c);
    if key.is_empty() || key.len() > 64 || !key.chars().all(is_plain) {
        return Err(format!(
            "'{key}' is no key: up to 64 of a to z, 0 to 9, '_' and '.'"
        ));
    }
    if value.is_empty() || value.len() > VALUE_BYTES {
        return Err(format!("{key} needs a value of 1 to {VALUE_BYTES} bytes"));
    }
    Ok((key.to_owned(), value.to_owned()))
}

/// Conditions by the flags, each said once.
pub(super) fn of(args: &Args) -> Result<Conditions, CliError> {
    let mut conditions = Conditions {
        note: args.note.clone(),
        water_temperature_c: args.water_temp,
        salinity_gpkg: args.salinity,
        ballast_kg: args.ballast,
        operator: args.operator.clone(),
        medium: args.using.medium,
        ..Conditions::default()
    };
    set(&mut conditions, &args.set).map_err(CliError::Config)?;
    Ok(conditions)
}

fn set(conditions: &mut Conditions, keys: &[(String, String)]) -> Result<(), String> {
    for (key, value) in keys {
        let twice = || format!("--set {key}: said twice; leave one of them out");
        let (field, least) = match key.as_str() {
            "water.temperature_c" => (&mut conditions.water_temperature_c, None),
            "water.salinity_gpkg" => (&mut conditions.salinity_gpkg, Some(())),
            "ballast_kg" => (&mut conditions.ballast_kg, Some(())),
            _ => {
                let before = conditions.set.insert(key.clone(), value.clone());
                if before.is_some() {
                    return Err(twice());
                }
                continue;
            }
        };
        let number = match least {
            Some(()) => inputs::not_negative(value),
            None => value
                .parse()
                .map_err(|_| format!("'{value}' is not a number")),
        };
        let number = number.map_err(|e| format!("--set {key}: {e}"))?;
        if field.replace(number).is_some() {
            return Err(twice());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(of: &[&str]) -> Vec<(String, String)> {
        of.iter().map(|text| key_value(text).unwrap()).collect()
    }

    #[test]
    fn known_keys_are_the_flags_and_others_are_kept_as_typed() {
        let mut conditions = Conditions::default();
        let all = keys(&["water.temperature_c=18.2", "ballast_kg=0.3", "paint=a=b c"]);
        set(&mut conditions, &all).unwrap();
        assert_eq!(conditions.water_temperature_c, Some(18.2));
        assert_eq!(conditions.ballast_kg, Some(0.3));
        assert_eq!(conditions.set["paint"], "a=b c");
        assert_eq!(conditions.set.len(), 1);
    }

    #[test]
    fn what_is_wrong_is_refused_with_its_key() {
        for text in ["paint", "=1", "Paint=1", "a b=1", "paint="] {
            assert!(key_value(text).is_err(), "{text}");
        }
        for wrong in [
            &["ballast_kg=-1"][..],
            &["water.temperature_c=warm"],
            &["a=1", "a=2"],
        ] {
            let words = set(&mut Conditions::default(), &keys(wrong)).unwrap_err();
            assert!(words.starts_with("--set "), "{words}");
        }
        let mut given = Conditions {
            ballast_kg: Some(1.0),
            ..Conditions::default()
        };
        assert!(set(&mut given, &keys(&["ballast_kg=2"])).is_err());
    }
}
