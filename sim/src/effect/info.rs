//! Description of an effect apart from its code.

/// Where in the chain from command to measurement an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Stage {
    /// Clocks and delays.
    Timing,
    /// Between the commanded and the real wrench.
    Thruster,
    /// Between the wrench and the acceleration.
    Hydrodynamics,
    /// Between the motion and what was measured of it.
    Measurement,
}

impl Stage {
    /// Name in verdicts.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Timing => "timing",
            Stage::Thruster => "thruster",
            Stage::Hydrodynamics => "hydrodynamics",
            Stage::Measurement => "measurement",
        }
    }
}

/// A numeric parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterInfo {
    /// Name in rig files, with its unit.
    pub name: &'static str,
    /// Unit, in the words of theory/priors.md, vehicles of another size: by it the plausible range follows the vehicle's size.
    pub unit: &'static str,
    /// Meaning, in a few words.
    pub meaning: &'static str,
    /// Range that a tank run may show: a prior. Beyond it is allowed, with a note. A range of one sign over a ratio of 4 and more
    /// is searched by its logarithm: the other sign is never looked for, though `limits` may allow it in a rig file. Where
    /// either sign may occur the range spans 0.
    pub plausible: (f64, f64),
    /// Beyond these the law makes no sense: refused.
    pub limits: (f64, f64),
    /// Value a search may start from.
    pub typical: f64,
    /// Value when it is not given; `None`: it must be given.
    pub absent: Option<f64>,
    /// A limit on the load: does nothing above the largest load, not at 0.
    pub bounds_load: bool,
    /// Says with another number the same thing twice: a fit leaves it at what it is when absent.
    pub held: bool,
}

impl ParameterInfo {
    /// A parameter that must be given.
    pub(super) const fn new(
        name: &'static str,
        unit: &'static str,
        meaning: &'static str,
        plausible: (f64, f64),
        limits: (f64, f64),
        typical: f64,
    ) -> Self {
        ParameterInfo {
            name,
            unit,
            meaning,
            plausible,
            limits,
            typical,
            absent: None,
            bounds_load: false,
            held: false,
        }
    }

    /// The same, as a limit on the load.
    pub(super) const fn limit(self) -> Self {
        ParameterInfo {
            bounds_load: true,
            ..self
        }
    }

    /// The same, left alone by fits.
    pub(super) const fn held(self) -> Self {
        ParameterInfo { held: true, ..self }
    }

    /// The same, with a value for when it is not given.
    pub(super) const fn or(self, value: f64) -> Self {
        ParameterInfo {
            absent: Some(value),
            ..self
        }
    }
}

/// A parameter that is a word.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WordInfo {
    /// Name in rig files.
    pub name: &'static str,
    /// Meaning, in a few words.
    pub meaning: &'static str,
    /// Words it accepts.
    pub allowed: &'static [&'static str],
    /// Word when it is not given; `None`: it must be given.
    pub absent: Option<&'static str>,
}

/// One effect of the library.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EffectInfo {
    /// Id, as in `[[physics]] effect = "..."` and in verdicts.
    pub id: &'static str,
    /// Its law in one line.
    pub law: &'static str,
    /// Where it acts.
    pub stage: Stage,
    /// Order within the stage, ascending; no two of a stage share one (a test names the next free one).
    pub order: u16,
    /// Parameters that are numbers.
    pub parameters: &'static [ParameterInfo],
    /// Parameters that are words.
    pub words: &'static [WordInfo],
    /// Ids it can be mistaken for; one of the two files says it ([`EffectInfo::confusable_with`] holds both ways).
    pub confusable: &'static [&'static str],
    /// Where the law is from.
    pub source: &'static str,
}

impl EffectInfo {
    /// Whether it is a table of forces.
    pub fn is_a_table(&self) -> bool {
        self.id == super::free_force::INFO.id
    }

    /// Whether its law is whatever data wrote into it, as a table or in closed form: no hypothesis by itself.
    pub fn is_written(&self) -> bool {
        self.is_a_table() || self.id == super::written_force::INFO.id
    }

    /// Index of a numeric parameter.
    pub fn parameter_index(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|p| p.name == name)
    }
}

impl WordInfo {
    /// Index in SNAME order of the DOF that its `word`-th word names.
    pub(super) fn dof(&self, word: usize) -> usize {
        let named = self.allowed.get(word);
        let dof = DOF_WORDS.iter().position(|dof| named == Some(dof));
        dof.unwrap_or(word)
    }
}

/// The six DOFs' names, for `dof` words.
const DOF_WORDS: &[&str] = &["surge", "sway", "heave", "roll", "pitch", "yaw"];
/// The usual `dof` word: surge when not given.
pub(super) const DOF: WordInfo = WordInfo {
    name: "dof",
    meaning: "degree of freedom that it acts in",
    allowed: DOF_WORDS,
    absent: Some("surge"),
};
