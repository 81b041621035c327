//! An FMU (FMI 3.0, co-simulation): description, the rig in its resources, and the library that moves it.

use hydroline_fmu::variables::{Causality, Variable};
use hydroline_fmu::{IDENTIFIER, platform, token, variables};
use hydroline_rigs::Rig;

use super::About;
use super::xml::Xml;
use crate::formula::number;
use crate::model::ModelError;
use crate::stored::Stored;

/// Step that an importer may begin with \[s\].
const STEP_S: f64 = 0.02;
/// Length of a run that it may begin with \[s\].
const LENGTH_S: f64 = 30.0;

/// Units with their powers of kilogram, metre and second; of an angle the radian's.
const UNITS: [(&str, &str); 11] = [
    ("m", "m=\"1\""),
    ("rad", "rad=\"1\""),
    ("m/s", "m=\"1\" s=\"-1\""),
    ("rad/s", "rad=\"1\" s=\"-1\""),
    ("N", "kg=\"1\" m=\"1\" s=\"-2\""),
    ("kg", "kg=\"1\""),
    ("kg/s", "kg=\"1\" s=\"-1\""),
    ("kg/m", "kg=\"1\" m=\"-1\""),
    ("kg.m2", "kg=\"1\" m=\"2\""),
    ("kg.m2/s", "kg=\"1\" m=\"2\" s=\"-1\""),
    ("s", "s=\"1\""),
];

fn variable(xml: &mut Xml, v: &Variable) {
    let role = match v.causality {
        // Held over a step: an importer does not interpolate it.
        Causality::Input => "causality=\"input\" variability=\"discrete\"",
        Causality::Output => "causality=\"output\"",
        Causality::Parameter => "causality=\"parameter\" variability=\"fixed\"",
    };
    let start = match v.causality {
        Causality::Output => String::new(),
        _ => format!(" start=\"{}\"", number(v.start)),
    };
    xml.empty(&format!(
        "Float64 name=\"{}\" valueReference=\"{}\" {role} unit=\"{}\"{start}",
        v.name, v.reference, v.unit
    ));
}

/// `modelDescription.xml`.
fn description(
    rig: &Rig,
    token: &str,
    all: &[Variable],
    about: &About<'_>,
    head: &[String],
) -> String {
    let mut xml = Xml::new(head);
    xml.begin(&format!(
        "fmiModelDescription fmiVersion=\"3.0\" modelName=\"{}\" instantiationToken=\"{}\" generationTool=\"{}\" variableNamingConvention=\"flat\"",
        rig.name,
        token,
        about.made_by
    ));
    xml.empty(&format!(
        "CoSimulation modelIdentifier=\"{IDENTIFIER}\" canHandleVariableCommunicationStepSize=\"true\" canBeInstantiatedOnlyOncePerProcess=\"false\""
    ));
    xml.begin("UnitDefinitions");
    for (name, powers) in UNITS {
        xml.begin(&format!("Unit name=\"{name}\""));
        xml.empty(&format!("BaseUnit {powers}"));
        xml.end();
    }
    xml.end();
    // What the library says goes by this name.
    xml.begin("LogCategories");
    xml.empty("Category name=\"logStatusError\"");
    xml.end();
    xml.empty(&format!(
        "DefaultExperiment startTime=\"0\" stopTime=\"{LENGTH_S}\" stepSize=\"{STEP_S}\""
    ));
    xml.begin("ModelVariables");
    xml.empty("Float64 name=\"time\" valueReference=\"0\" causality=\"independent\" variability=\"continuous\" unit=\"s\"");
    for v in all {
        variable(&mut xml, v);
    }
    xml.end();
    xml.begin("ModelStructure");
    for element in ["Output", "InitialUnknown"] {
        for v in all.iter().filter(|v| v.causality == Causality::Output) {
            xml.empty(&format!("{element} valueReference=\"{}\"", v.reference));
        }
    }
    xml.finish()
}

/// The whole FMU.
pub(super) fn bytes(rig: &Rig, about: &About<'_>, head: &[String]) -> Result<Vec<u8>, ModelError> {
    let library = about.library.ok_or(ModelError::NoLibrary)?;
    let platform = platform().ok_or(ModelError::NoPlatform {
        system: std::env::consts::OS,
        machine: std::env::consts::ARCH,
    })?;
    let all = variables(rig);
    // As it is now: a rig may have been changed since it was read.
    let text = rig.to_toml();
    let mut fmu = Stored::default();
    fmu.add(
        "modelDescription.xml",
        description(rig, &token(&text), &all, about, head).as_bytes(),
    )?;
    fmu.add("resources/rig.toml", text.as_bytes())?;
    fmu.add(
        "documentation/model.txt",
        (head.join("\n") + "\n").as_bytes(),
    )?;
    let ending = std::env::consts::DLL_SUFFIX;
    fmu.add(
        &format!("binaries/{platform}/{IDENTIFIER}{ending}"),
        library,
    )?;
    Ok(fmu.finish()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stored::tests::files;
    use crate::target::{Target, export};
    use hydroline_fmu::Instance;
    use roxmltree::Document;

    /// The parts of the archive belong together: the library's own reader takes the resources by the description's token, and every
    /// variable of the description answers with its start.
    #[test]
    fn an_fmu_holds_what_its_library_answers_to() {
        let rig = Rig::builtin("lshpi").unwrap();
        let about = About {
            made_by: "hydroline",
            ranges: &[],
            function: "f",
            library: Some(b"a library"),
        };
        let made = export(&rig, Target::Fmu, &about).unwrap();
        assert!(made.lost.is_empty() && made.differences.is_empty());
        let files = files(&made.bytes);
        let of = |name: &str| &files.iter().find(|f| f.0 == name).unwrap().1;
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("rig.toml"), of("resources/rig.toml")).unwrap();
        let text = String::from_utf8(of("modelDescription.xml").clone()).unwrap();
        let document = Document::parse(&text).unwrap();
        let root = document.root_element();
        let token = root.attribute("instantiationToken").unwrap();
        let mut instance = Instance::read(folder.path(), token).unwrap();
        let variables = document.descendants().filter(|n| n.has_tag_name("Float64"));
        let (mut seen, mut outputs) = (0, Vec::new());
        for v in variables {
            let reference: u32 = v.attribute("valueReference").unwrap().parse().unwrap();
            let answer = instance.get(reference).unwrap();
            if let Some(start) = v.attribute("start") {
                assert_eq!(
                    answer,
                    start.parse::<f64>().unwrap(),
                    "{:?}",
                    v.attribute("name")
                );
            }
            if v.attribute("causality") == Some("output") {
                outputs.push(v.attribute("valueReference").unwrap());
            }
            seen += 1;
        }
        assert_eq!(seen, 1 + 8 + 12 + 29);
        let listed: Vec<&str> = document
            .descendants()
            .filter(|n| n.has_tag_name("Output"))
            .filter_map(|n| n.attribute("valueReference"))
            .collect();
        assert_eq!(listed, outputs);
        let known: Vec<&str> = document
            .descendants()
            .filter(|n| n.has_tag_name("Unit"))
            .filter_map(|n| n.attribute("name"))
            .collect();
        assert!(
            document
                .descendants()
                .filter_map(|n| n.attribute("unit"))
                .all(|u| known.contains(&u))
        );
        let binary = format!(
            "binaries/{}/{IDENTIFIER}{}",
            platform().unwrap(),
            std::env::consts::DLL_SUFFIX
        );
        assert_eq!(of(&binary), b"a library");
        let bare = About {
            library: None,
            ..about
        };
        let words = export(&rig, Target::Fmu, &bare).unwrap_err().to_string();
        assert!(words.contains("HYDROLINE_FMU_LIBRARY"), "{words}");
    }
}
