//! A vessel of the MSS toolbox, or any program of MATLAB that writes its numbers as assignments.

use super::Foreign;

/// Numbers that lines assign, several in a line too: `Xudot = -7.6e-3; Xwq = -2.0e-1;`. Expressions are left out.
pub fn read(text: &str) -> Foreign {
    let mut found = Foreign::default();
    for line in text.lines() {
        let code = line.split('%').next().unwrap_or_default();
        for statement in code.split([';', ',']) {
            let Some((name, value)) = statement.split_once('=') else {
                continue;
            };
            let name = name.trim().rsplit('.').next().unwrap_or_default();
            let is_name = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
            let Ok(value) = value.trim().parse::<f64>() else {
                if super::named(name).is_some_and(|n| n.is_ok()) && is_name {
                    found.left.push(format!(
                        "{name}: its value is computed ({}), not written",
                        value.trim()
                    ));
                }
                continue;
            };
            if is_name && value.is_finite() {
                found.take(name, value);
            }
        }
    }
    found
}
