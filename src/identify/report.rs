//! One self-contained HTML page: text, tables and inline SVG, nothing fetched.
//!
//! Own SVG writer: a line chart is thirty lines, and the page must not carry a script or a font.

use std::fmt::Write as _;

use super::outcome::{Identification, Trace};

/// Style sheet of the pages.
pub const STYLE: &str = "body{font:15px/1.45 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#222}\
table{border-collapse:collapse;margin:.6em 0}td,th{padding:.15em .7em;border-bottom:1px solid #ddd;text-align:right}\
td:first-child,th:first-child{text-align:left}svg{display:block;margin:.4em 0}.warn{color:#a40}h2{margin-top:1.6em}";

/// The page.
pub fn html(result: &Identification, command: &str) -> String {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>hydroline identify: {0}</title><style>{STYLE}</style></head><body>\n<h1>Identification: {0}</h1>\n<p>Method {1}, {2} evaluations{3}. <code>{4}</code></p>\n",
        escape(&result.model),
        escape(&result.method),
        result.evaluations,
        if result.converged {
            ""
        } else {
            " <span class=\"warn\">(not converged)</span>"
        },
        escape(command),
    );
    for words in &result.misfit {
        let _ = writeln!(page, "<p class=\"warn\">{}</p>", escape(words));
    }
    parameters(&mut page, result);
    correlations(&mut page, result);
    noise(&mut page, result);
    let _ = writeln!(page, "<h2>Runs</h2>");
    for trace in &result.traces {
        if trace.measured.iter().filter(|v| v.is_finite()).count() < 2 {
            continue;
        }
        let _ = writeln!(
            page,
            "<h3>{}: {}</h3>",
            escape(&trace.run),
            escape(&trace.channel)
        );
        page += &fit_chart(trace);
        page += &residual_chart(trace);
    }
    validation(&mut page, result);
    let _ = writeln!(page, "<h2>Blind spots</h2><ul>");
    for spot in &result.blind_spots {
        let _ = writeln!(
            page,
            "<li><b>{}</b>: {}. To break it: {}</li>",
            escape(&spot.what),
            escape(&spot.why),
            escape(&spot.experiment)
        );
    }
    let _ = writeln!(page, "</ul><h2>Remarks</h2><ul>");
    for note in result
        .notes
        .iter()
        .chain(result.runs.iter().flat_map(|r| &r.notes))
    {
        let _ = writeln!(page, "<li>{}</li>", escape(note));
    }
    page += "</ul></body></html>\n";
    page
}

fn parameters(page: &mut String, result: &Identification) {
    page.push_str("<h2>Coefficients</h2><table><tr><th></th><th>value</th><th>sd</th><th>95 % interval</th><th>rig</th><th>unit</th></tr>\n");
    for key in &result.order {
        let Some(p) = result.parameters.get(key) else {
            continue;
        };
        let number = |v: Option<f64>| v.map_or("-".to_owned(), significant);
        let _ = writeln!(
            page,
            "<tr{}><td>{}</td><td>{}</td><td>{}</td><td>{} .. {}{}</td><td>{}</td><td>{}</td></tr>",
            if p.excited { "" } else { " class=\"warn\"" },
            escape(&p.symbol),
            significant(p.value),
            number(p.sd),
            number(p.low),
            number(p.high),
            if p.profile.is_some() {
                " (profile)"
            } else {
                ""
            },
            significant(p.rig),
            escape(&p.unit),
        );
    }
    page.push_str("</table>\n");
}

fn correlations(page: &mut String, result: &Identification) {
    page.push_str("<h2>Correlations</h2><table><tr><th></th>");
    for key in &result.order {
        let _ = write!(page, "<th>{}</th>", escape(key));
    }
    page.push_str("</tr>\n");
    for (key, row) in result.order.iter().zip(&result.correlation) {
        let _ = write!(page, "<tr><td>{}</td>", escape(key));
        for value in row {
            let strength = (value.abs() * 60.0) as u32;
            let hue = if *value < 0.0 { 210 } else { 20 };
            let _ = write!(
                page,
                "<td style=\"background:hsl({hue} 80% {}%)\">{value:.2}</td>",
                100 - strength / 2
            );
        }
        page.push_str("</tr>\n");
    }
    page.push_str("</table>\n");
}

fn noise(page: &mut String, result: &Identification) {
    page.push_str("<h2>Noise</h2><table><tr><th></th><th>white sd</th><th>coloured sd</th><th>correlation [s]</th><th>outliers</th><th>from</th><th>times the logged sd</th></tr>\n");
    for (slot, n) in &result.noise {
        let _ = writeln!(
            page,
            "<tr><td>{}</td><td>{:.3e}</td><td>{:.3e}</td><td>{:.3}</td><td>{:.2} %</td><td>{}</td><td>{}</td></tr>",
            escape(slot),
            n.noise.white_sd,
            n.noise.coloured_sd,
            n.noise.correlation_s,
            100.0 * n.outliers,
            escape(&n.source),
            n.logged.map_or("-".to_owned(), |l| format!(
                "{:.2} ({:.2e} .. {:.2e})",
                l.scale, l.least_sd, l.greatest_sd
            ))
        );
    }
    page.push_str("</table>\n<table><tr><th>residuals</th><th>rms</th><th>Ljung-Box p</th><th>lag 1</th><th>p after colour</th><th>p beside rest</th></tr>\n");
    for r in &result.residuals {
        let p = |w: Option<super::statistics::Whiteness>| {
            w.map_or("-".to_owned(), |w| format!("{:.2e}", w.p_value))
        };
        let lag = r.plain.map_or("-".to_owned(), |w| format!("{:.2}", w.lag1));
        let _ = writeln!(
            page,
            "<tr><td>{} {}</td><td>{:.3e}</td><td>{}</td><td>{lag}</td><td>{}</td><td>{}</td></tr>",
            escape(&r.run),
            escape(&r.slot),
            r.rms,
            p(r.plain),
            p(r.filtered),
            p(r.at_rest)
        );
    }
    page.push_str("</table>\n");
}

fn validation(page: &mut String, result: &Identification) {
    if result.cross_validation.is_empty() {
        return;
    }
    page.push_str("<h2>Each run predicted by the others</h2><table><tr><th>run</th><th>channel</th><th>rms left out</th><th>rms fitted</th></tr>\n");
    for cv in &result.cross_validation {
        for (channel, rms) in &cv.left_out {
            let fitted = cv.fitted.get(channel).copied().unwrap_or(f64::NAN);
            let _ = writeln!(
                page,
                "<tr><td>{}</td><td>{}</td><td>{rms:.3e}</td><td>{fitted:.3e}</td></tr>",
                escape(&cv.run),
                escape(channel)
            );
        }
    }
    page.push_str("</table>\n");
}

fn fit_chart(trace: &Trace) -> String {
    chart(
        &[
            ("#999", &trace.measured, "measured"),
            ("#c30", &trace.fitted, "fitted"),
        ],
        &trace.times_s,
        220.0,
        &trace.channel,
    )
}

fn residual_chart(trace: &Trace) -> String {
    let residual: Vec<f64> = trace
        .measured
        .iter()
        .zip(&trace.fitted)
        .map(|(m, f)| m - f)
        .collect();
    chart(
        &[("#06a", &residual, "measured - fitted")],
        &trace.times_s,
        120.0,
        "residual",
    )
}

/// Lines over time as SVG; at most 1500 points each, NaN breaks a line.
pub fn chart(lines: &[(&str, &[f64], &str)], times_s: &[f64], height: f64, label: &str) -> String {
    const WIDTH: f64 = 860.0;
    const LEFT: f64 = 80.0;
    let all = lines
        .iter()
        .flat_map(|l| l.1)
        .copied()
        .filter(|v| v.is_finite());
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| {
        (l.min(v), h.max(v))
    });
    let (t0, t1) = (
        times_s.first().copied().unwrap_or(0.0),
        times_s.last().copied().unwrap_or(1.0),
    );
    if !(high.is_finite() && low.is_finite()) {
        return String::new();
    }
    let (high, low) = if high > low {
        (high, low)
    } else {
        (high + 1.0, low - 1.0)
    };
    let x = |t: f64| LEFT + (WIDTH - LEFT - 10.0) * (t - t0) / (t1 - t0).max(1e-9);
    let y = |v: f64| 10.0 + (height - 35.0) * (high - v) / (high - low);
    let mut svg = format!(
        "<svg width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\" font-size=\"11\" font-family=\"sans-serif\">"
    );
    for k in 0..=4 {
        let v = low + (high - low) * f64::from(k) / 4.0;
        let t = t0 + (t1 - t0) * f64::from(k) / 4.0;
        let _ = write!(
            svg,
            "<line x1=\"{LEFT}\" x2=\"{0}\" y1=\"{1:.1}\" y2=\"{1:.1}\" stroke=\"#eee\"/><text x=\"{2}\" y=\"{3:.1}\" text-anchor=\"end\">{4:.3e}</text><text x=\"{5:.1}\" y=\"{6:.1}\" text-anchor=\"middle\">{7:.1} s</text>",
            WIDTH - 10.0,
            y(v),
            LEFT - 6.0,
            y(v) + 4.0,
            v,
            x(t),
            height - 8.0,
            t
        );
    }
    for (i, (colour, values, name)) in lines.iter().enumerate() {
        let stride = values.len().div_ceil(1500).max(1);
        let mut path = String::new();
        let mut pen = 'M';
        for (t, v) in times_s.iter().zip(values.iter()).step_by(stride) {
            if v.is_finite() {
                let _ = write!(path, "{pen}{:.1} {:.1}", x(*t), y(*v));
                pen = 'L';
            } else {
                pen = 'M';
            }
        }
        let _ = write!(
            svg,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.3\"/><text x=\"{}\" y=\"{}\" fill=\"{colour}\">{}</text>",
            LEFT + 8.0,
            20.0 + 13.0 * i as f64,
            escape(name)
        );
    }
    let _ = write!(
        svg,
        "<text x=\"{}\" y=\"20\" text-anchor=\"end\">{}</text></svg>",
        WIDTH - 14.0,
        escape(label)
    );
    svg
}

/// Five significant digits, plain where that is readable.
pub fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let places = (4 - value.abs().log10().floor() as i32).clamp(0, 8) as usize;
    if value.abs() < 1e-4 {
        format!("{value:.4e}")
    } else {
        format!("{value:.places$}")
    }
}

/// Text as markup shows it.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_five_digits() {
        assert_eq!(significant(-250.0612), "-250.06");
        assert_eq!(significant(-0.0123456), "-0.012346");
        assert_eq!(significant(123456.7), "123457");
        assert_eq!(significant(1.23e-7), "1.2300e-7");
    }

    #[test]
    fn a_chart_is_closed_svg_and_breaks_at_gaps() {
        let svg = chart(
            &[("#000", &[0.0, f64::NAN, 1.0, 2.0], "a<b")],
            &[0.0, 1.0, 2.0, 3.0],
            100.0,
            "x",
        );
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>") && svg.contains("a&lt;b"));
        assert_eq!(svg.matches('M').count(), 2);
        assert!(!svg.contains("NaN") && !svg.contains("http"));
    }
}
