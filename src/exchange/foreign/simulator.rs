//! Models of Gazebo (its hydrodynamics plugin, fluid added mass) and of UUV Simulator.

use hydroline_identify::parameter::{Coefficient, Term};
use hydroline_rigs::Dof;
use roxmltree::{Document, Node};

use super::{Foreign, Number};

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split_whitespace().map(|v| v.parse().ok()).collect()
}

fn value(node: Node<'_, '_>) -> Option<f64> {
    node.text().and_then(|t| t.trim().parse().ok())
}

fn child<'a, 'd>(node: Node<'a, 'd>, name: &str) -> Option<Node<'a, 'd>> {
    node.children().find(|c| c.has_tag_name(name))
}

fn coefficient(dof: usize, term: Term) -> Number {
    Number::Coefficient(Coefficient {
        dof: Dof::ALL[dof],
        term,
    })
}

/// A matrix of 36 or a diagonal of 6; off the diagonal it is said.
fn diagonal(
    found: &mut Foreign,
    name: &str,
    node: Node<'_, '_>,
    term: Term,
    sign: f64,
) -> Result<(), String> {
    let text = node.text().unwrap_or_default();
    let all = numbers(text).ok_or_else(|| {
        format!(
            "{name}: '{}' are not numbers (a macro's names have none)",
            text.trim()
        )
    })?;
    let at = |d: usize| match all.len() {
        36 => Some(all[7 * d]),
        6 => Some(all[d]),
        _ => None,
    };
    for d in 0..6 {
        let value =
            at(d).ok_or_else(|| format!("{name}: {} numbers; 6 or 36 are needed", all.len()))?;
        found.add(coefficient(d, term), sign * value + 0.0);
    }
    let crossed = (0..all.len())
        .filter(|k| all.len() == 36 && k % 7 != 0 && all[*k] != 0.0)
        .count();
    if crossed > 0 {
        found.left.push(format!(
            "{name}: {crossed} numbers off the diagonal: Eq. 1 has no place for them"
        ));
    }
    Ok(())
}

fn gazebo(found: &mut Foreign, plugin: Node<'_, '_>) {
    for node in plugin.children().filter(Node::is_element) {
        if let Some(value) = value(node) {
            let name = node.tag_name().name();
            // xUU, without abs, is by u u and not by u |u|: it drives astern.
            let is_plain = name.len() == 3 && name[1..].chars().all(char::is_uppercase);
            if is_plain && value != 0.0 {
                found.left.push(format!("{name} = {value}: a square without its sign, which Eq. 1 has not ({}abs{} is by u |u|)", &name[..2], &name[2..]));
            } else if !is_plain {
                found.take(name, value);
            }
        }
    }
}

/// The link that carries the hydrodynamics, its mass and inertia.
fn body(found: &mut Foreign, document: &Document<'_>, name: Option<&str>) {
    let links = document.descendants().filter(|n| n.has_tag_name("link"));
    let links = links.filter(|l| child(*l, "inertial").is_some());
    let mut links: Vec<Node<'_, '_>> = links.collect();
    links.sort_by_key(|l| l.attribute("name") != name);
    let Some(inertial) = links.first().and_then(|l| child(*l, "inertial")) else {
        return;
    };
    // SDF has texts, URDF attributes.
    let mass = child(inertial, "mass");
    let mass = mass.and_then(|m| {
        m.attribute("value")
            .map_or_else(|| value(m), |v| v.parse().ok())
    });
    if let Some(mass) = mass {
        found.add(Number::Mass, mass);
    }
    let Some(inertia) = child(inertial, "inertia") else {
        return;
    };
    for (k, name) in ["ixx", "iyy", "izz"].into_iter().enumerate() {
        let of = inertia.attribute(name).map(str::parse);
        let of = of
            .and_then(Result::ok)
            .or_else(|| child(inertia, name).and_then(value));
        if let Some(of) = of {
            found.add(Number::Inertia(k), of);
        }
    }
}

/// Reads a model.
pub fn read(text: &str) -> Result<Foreign, String> {
    let document = Document::parse(text).map_err(|e| format!("no XML: {e}"))?;
    let mut found = Foreign::default();
    let mut link = None;
    for plugin in document.descendants().filter(|n| n.has_tag_name("plugin")) {
        let file = plugin
            .attribute("filename")
            .unwrap_or_default()
            .to_lowercase();
        if file.contains("hydrodynamics") {
            gazebo(&mut found, plugin);
            link = child(plugin, "link_name")
                .and_then(|n| n.text())
                .map(str::trim);
        }
    }
    for added in document
        .descendants()
        .filter(|n| n.has_tag_name("fluid_added_mass"))
    {
        for (d, name) in ["xx", "yy", "zz", "pp", "qq", "rr"].into_iter().enumerate() {
            if let Some(value) = child(added, name).and_then(value) {
                found.add(coefficient(d, Term::Added), -value + 0.0);
            }
        }
    }
    for model in document
        .descendants()
        .filter(|n| n.has_tag_name("hydrodynamic_model"))
    {
        for (name, term, sign) in [
            ("added_mass", Term::Added, -1.0),
            ("linear_damping", Term::Linear, 1.0),
            ("quadratic_damping", Term::Quadratic, 1.0),
        ] {
            if let Some(node) = child(model, name) {
                diagonal(&mut found, name, node, term, sign)?;
            }
        }
        link = model.parent().and_then(|l| l.attribute("name"));
    }
    body(&mut found, &document, link);
    Ok(found)
}
