//! `[instrument]`: the rigid instrument that meets the top face.

use super::section::{Scope, Section, choice, section, words};
use super::values::Values;
use super::{Key, Metres, MetresPerSecond, Pascals, Radians, Range, SceneError};

const LENGTH: Range = Range::above(0.0, 10.0);
/// Coefficients of friction; from about 10 on hardly anything slides.
pub(super) const FRICTION: Range = Range::closed(0.0, 100.0);
pub(super) const SHARE: Range = Range::closed(0.0, 1.0);
const WALL: Key = Key::boolean("instrument.wall_contact").or("true");
/// What a plate or an indenter has, and a needle doesn't.
const PRESSING: [&str; 2] = ["plate", "indenter"];
const DIAMETER: Key = Key::real("instrument.diameter_m", LENGTH, "m");
/// An indenter is flat or half a ball; a needle flat, conical or bevelled.
const TIP: Key = Key::word("instrument.tip", &["flat", "conical", "bevel", "sphere"]).or("flat");
/// A plate covers the whole face: it has no entry point.
const WITH_ENTRY: [&str; 2] = ["indenter", "needle"];

/// The rigid instrument that meets the top face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    /// Plate, indenter or needle.
    pub kind: InstrumentKind,
    /// Where the instrument's axis meets the top face: x, y in frame `sample`; zero for a plate.
    pub entry: [Metres; 2],
    /// How the tissue meets a plate or indenter; bonded for a needle.
    pub contact: ContactLaw,
    /// Way from the tip up along the axis to the load cell's origin, about which torques are taken.
    pub load_cell_height: Metres,
    /// How the tissue goes with a needle; kinematic for others.
    pub interaction: Interaction,
}

choice! {
    /// Kind of instrument with the keys that only it has (`instrument.kind`).
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum InstrumentKind = Key::word("instrument.kind", InstrumentKind::WORDS)
        .described("What meets the top face.")
    => {
        /// Covers the whole top face.
        "plate" => Plate,
        /// Upright cylinder that presses on the top face.
        "indenter" => Indenter {
            /// Diameter of the indenter's face or the needle's shaft.
            diameter: Metres = DIAMETER,
            /// Lower end of the instrument. Of an indenter: flat, or a half ball of the same diameter ("sphere"). Of a needle: flat or
            /// conical, which push along its axis alone, or a bevel, which pushes it aside as well.
            tip: IndenterTip = TIP,
            /// Whether free tissue is kept outside the side wall of a bonded indenter, or of a kinematic needle before the puncture; in
            /// contact without a bond it always is.
            wall_contact: bool = WALL,
        },
        /// Kinematic needle of the source paper.
        "needle" => Needle(needle: Needle),
    }
}

section! {
    /// Kinematic needle.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Needle => {
        /// Diameter of the indenter's face or the needle's shaft.
        diameter: Metres = DIAMETER,
        /// Material within this distance of the axis and behind the tip moves with the needle.
        capture_radius: Metres = Key::real("instrument.capture_radius_m", LENGTH, "m"),
        /// Way of the tip over which material ahead of it is captured along the needle; 0 takes 3/8 of the capture radius, or two layers
        /// of nodes where those are longer, since a longer window holds tissue that is free and a shorter one makes a saw-tooth.
        capture_window: Metres = Key::real("instrument.capture_window_m", Range::closed(0.0, 10.0), "m").or("0.0"),
        /// C_D: fraction of the needle's displacement that captured material follows.
        deformation_coefficient: f64 = Key::real("instrument.deformation_coefficient", SHARE, "").or("0.4").live(),
        /// C_R: the same fraction while the needle is withdrawn. With another one tissue stays displaced when the needle is out.
        retraction_coefficient: f64 =
            Key::real("instrument.retraction_coefficient", SHARE, "").or("0.4").or_as("instrument.deformation_coefficient").live(),
        /// Whether captured material follows the displacement since its capture or since first contact.
        deformation_rule: DeformationRule =
            Key::word("instrument.deformation_rule", <DeformationRule as super::Word>::WORDS)
                .for_research_after(1)
                .or("incremental"),
        /// Largest principal Green-Lagrange strain under the tip at which the surface is punctured.
        puncture_strain: f64 = Key::real("instrument.puncture_strain", Range::closed(0.0, 10.0), "").or("1e-6").live(),
        /// Whether free tissue is kept outside the side wall of a bonded indenter, or of a kinematic needle before the puncture; in
        /// contact without a bond it always is.
        wall_contact: bool = WALL,
        /// Angle between the needle's path and the vertical.
        tilt: Radians = Key::real("instrument.tilt_rad", Range::closed(0.0, 0.7), "rad").or("0.0"),
        /// Direction, from x towards y, in which an oblique needle moves sideways on its way down.
        azimuth: Radians = Key::real("instrument.azimuth_rad", Range::closed(-6.3, 6.3), "rad").or("0.0"),
        /// Lower end of the instrument. Of an indenter: flat, or a half ball of the same diameter ("sphere"). Of a needle: flat or
        /// conical, which push along its axis alone, or a bevel, which pushes it aside as well.
        tip: NeedleTip = TIP,
        /// The bevel of a tip that has one.
        bevel: Option<Bevel>,
        /// How the shaft bends; `None`: not at all.
        flexible: Option<Flexible>,
    }
}

section! {
    /// A tip that is cut off at an angle.
    ///
    /// Tissue that is cut along the axis with a force F_c presses on the bevel's face, across it, where nothing rubs: so it pushes the tip aside with
    /// F_b = F_c / tan(alpha), towards the side of the point (Roesthuis and others 2011; Misra and others 2010).
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Bevel when |values| values.word("instrument.tip").is_some_and(|tip| tip == "bevel") => {
        /// alpha: angle between the face of a bevelled tip and the needle's axis.
        angle: Radians = Key::real("instrument.bevel_rad", Range::closed(0.05, 1.55), "rad").or("0.35")
            .only("instrument.tip", &["bevel"]),
        /// F_b: force with which the tissue that is cut pushes a bevelled tip aside; auto: the cutting force where the tip is over the
        /// tangent of `bevel_rad`.
        force: Option<f64> = Key::real("instrument.bevel_force_n", FORCE, "N").or_auto().only("instrument.tip", &["bevel"]),
        /// Rotation of the shaft about its axis, from where the bevel pushes the tip towards `azimuth_rad`, counter-clockwise as seen from
        /// above.
        roll: Radians = Key::real("instrument.roll_rad", Range::closed(-6.3, 6.3), "rad").or("0.0").only("instrument.tip", &["bevel"]),
    }
}

const FLEXIBLE: Key = Key::boolean("instrument.flexible").or("false").only("instrument.kind", &["needle"]);

section! {
    /// A shaft that bends: a tube that is clamped in the driver.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Flexible when |values| values.word("instrument.flexible").is_some_and(|yes| yes == "true") => {
        /// Whether the needle's shaft bends, as an elastic tube that is clamped in the driver.
        yes: bool = FLEXIBLE,
        /// Outer diameter of the tube; auto: `diameter_m`.
        outer_diameter: Option<Metres> = bends(Key::real("instrument.outer_diameter_m", LENGTH, "m")).or_auto(),
        /// Inner diameter of the tube; 0: a wire.
        inner_diameter: Metres = bends(Key::real("instrument.inner_diameter_m", Range::closed(0.0, 10.0), "m")).or("0.0"),
        /// Young's modulus of the tube; 2e11 is that of steel, nitinol has 6e10 or so.
        youngs_modulus: Pascals = bends(Key::real("instrument.youngs_modulus_pa", Range::closed(1e6, 1e15), "Pa")).or("2e11"),
        /// Torque with which tissue resists the shaft's rotation, per length of shaft: the tip of a turned needle lags behind the driver by what that
        /// twists. auto: friction per length times the radius for a needle with friction, and none for another.
        torsional_friction: Option<f64> =
            bends(Key::real("instrument.torsional_friction_n", Range::closed(0.0, 1e3), "N")).or_auto(),
        /// Length of the tube from the driver's clamp to the tip.
        length: Metres = bends(Key::real("instrument.length_m", LENGTH, "m")),
        /// Height in frame `sample` of a template whose hole on the needle's path holds the shaft sideways; auto: there is none.
        guide_z: Option<Metres> = bends(Key::real("instrument.guide_z_m", Range::closed(-10.0, 10.0), "m")).or_auto(),
    }
}

const fn bends(key: Key) -> Key {
    key.only("instrument.flexible", &["true"])
}

impl Flexible {
    /// The tube's section; D is that of a needle.
    pub(crate) fn section(&self, diameter: Metres) -> elastic_rod::Section {
        elastic_rod::Section {
            outer_diameter: self.outer_diameter.unwrap_or(diameter).get(),
            inner_diameter: self.inner_diameter.get(),
            youngs_modulus: self.youngs_modulus.get(),
        }
    }
}

choice! {
    /// How the tissue meets a plate or indenter (`instrument.contact`).
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum ContactLaw = Key::word("instrument.contact", ContactLaw::WORDS)
        .described("How the tissue meets the instrument: it sticks to it, slides freely, or sticks up to Coulomb's limit.")
        .or("bonded")
        .only("instrument.kind", &PRESSING)
    => {
        /// The face sticks; to a half ball tissue sticks wherever it is pressed on.
        "bonded" => Bonded,
        /// Pressure only.
        "frictionless" => Frictionless,
        /// Friction up to a share of the pressure.
        "coulomb" => Coulomb {
            /// mu: largest friction over pressure between tissue and instrument.
            friction_coefficient: f64 = Key::real("instrument.friction_coefficient", FRICTION, ""),
        },
    }
}

choice! {
    /// How the tissue goes with a needle (`instrument.interaction`).
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub enum Interaction = Key::word("instrument.interaction", Interaction::WORDS)
        .described("How tissue goes with a needle: by the source paper's rule, or held by friction and cut by the tip.")
        .or("kinematic")
        .only("instrument.kind", &["needle"])
    => {
        /// By the deformation coefficient: the source paper's rule.
        "kinematic" => Kinematic,
        /// Friction along the shaft, cutting at the tip, puncture.
        "frictional" => Frictional {
            /// Largest friction per length of shaft in what lies in no region; a material has its own.
            friction: f64 = Key::real("instrument.friction_n_per_m", PER_LENGTH, "N/m").or("0.0"),
            /// Friction over the normal pressure of the tissue on the shaft, added to the friction per length: mu 2 pi R p more per
            /// length in
            /// what lies in no region; a material has its own (`friction_coefficient`).
            shaft_friction_coefficient: f64 =
                Key::real("instrument.shaft_friction_coefficient", FRICTION, "").or("0.0"),
            /// Force of the tip at which it advances through what lies in no region; a material has its own.
            cutting_force: f64 = Key::real("instrument.cutting_force_n", FORCE, "N").or("0.0"),
            /// Force of the tip at which it enters what lies in no region; 0: no membrane.
            puncture_force: f64 = Key::real("instrument.puncture_force_n", FORCE, "N").or("0.0"),
            /// n: from the reference speed v_0 on the cutting force is (v / v_0)^n times as large, v being the speed with which the tip
            /// cuts;
            /// in what lies in no region. 0: the same at any speed; 0.5 for a gelatine gel of 10 % (Forte and others 2015).
            cutting_rate_exponent: f64 = Key::real("instrument.cutting_rate_exponent", SHARE, "").or("0.0"),
            /// v_0: up to this speed of the tip the cutting force is the same, in all materials. 10 mm/min by default (Forte and others
            /// 2015).
            cutting_rate_reference: MetresPerSecond =
                Key::real("instrument.cutting_rate_reference_m_per_s", Range::above(0.0, 100.0), "m/s").or("1.6667e-4"),
        },
    }
}

/// Friction per length of shaft.
pub(super) const PER_LENGTH: Range = Range::closed(0.0, 1e6);
/// Forces of a needle's tip.
pub(super) const FORCE: Range = Range::closed(0.0, 1e4);

section! {
    /// Entry point of whatever doesn't cover the whole face.
    struct Entry when |values| values.word("instrument.kind").is_some_and(|kind| WITH_ENTRY.contains(&kind.as_str())) => {
        /// Where the axis meets the top face: x.
        x: Metres = entry("instrument.entry_x_m"),
        /// Where the axis meets the top face: y.
        y: Metres = entry("instrument.entry_y_m"),
    }
}

section! {
    /// Where the load cell sits.
    struct LoadCell => {
        /// Way from the tip (the centre of a flat face) up along the instrument's axis to the load cell's origin, about which the torque of
        /// `predicted_cf` is taken; 0 is the tip itself.
        height: Metres = Key::real("instrument.load_cell_height_m", Range::closed(0.0, 10.0), "m").or("0.0"),
    }
}

/// Refuses a tip that the kind of instrument doesn't have.
fn check_tip(values: &Values) -> Result<(), SceneError> {
    let (kind, tip) = (values.word("instrument.kind"), values.word("instrument.tip"));
    let reason = match (kind.as_deref(), tip.as_deref()) {
        (Some("indenter"), Some("conical" | "bevel")) => "the tip of an indenter is \"flat\" or \"sphere\"",
        (Some("needle"), Some("sphere")) => "the tip of a needle is \"flat\", \"conical\" or \"bevel\"",
        _ => return Ok(()),
    };
    Err(SceneError::Inconsistent {
        place: values.place("instrument.tip"),
        key: "instrument.tip".to_owned(),
        value: tip.unwrap_or_default(),
        reason: reason.to_owned(),
    })
}

fn entry(path: &'static str) -> Key {
    Key::real(path, Range::closed(-10.0, 10.0), "m").or("0.0").only("instrument.kind", &WITH_ENTRY)
}

impl Section for Instrument {
    fn keys() -> Vec<Key> {
        [InstrumentKind::keys(), ContactLaw::keys(), Interaction::keys(), Entry::keys(), LoadCell::keys()].concat()
    }

    fn applies(values: &Values) -> bool {
        values.has_section("instrument")
    }

    fn read(values: &Values, scope: Scope<'_>) -> Result<Self, SceneError> {
        check_tip(values)?;
        let kind = InstrumentKind::read(values, scope)?;
        let entry = Option::<Entry>::read(values, scope)?;
        let pressing = PRESSING.contains(&kind.as_str());
        let contact = if pressing { ContactLaw::read(values, scope)? } else { ContactLaw::Bonded };
        let entry = entry.map_or([Metres(0.0); 2], |Entry { x, y }| [x, y]);
        let needle = matches!(kind, InstrumentKind::Needle(_));
        let interaction = if needle { Interaction::read(values, scope)? } else { Interaction::Kinematic };
        Ok(Self { kind, entry, contact, interaction, load_cell_height: LoadCell::read(values, scope)?.height })
    }

    fn write(&self, values: &mut Values, scope: Scope<'_>) {
        self.kind.write(values, scope);
        if PRESSING.contains(&self.kind.as_str()) {
            self.contact.write(values, scope);
        }
        if matches!(self.kind, InstrumentKind::Needle(_)) {
            self.interaction.write(values, scope);
        }
        if WITH_ENTRY.contains(&self.kind.as_str()) {
            let [x, y] = self.entry;
            Entry { x, y }.write(values, scope);
        }
        LoadCell { height: self.load_cell_height }.write(values, scope);
    }
}

impl Needle {
    /// Lateral way (x, y) per metre of depth: tan(tilt) in direction azimuth.
    #[must_use]
    pub(crate) fn slope(&self) -> [f64; 2] {
        let (sin, cos) = self.azimuth.get().sin_cos();
        let tan = self.tilt.get().tan();
        [tan * cos, tan * sin]
    }
}

impl Instrument {
    /// Of a needle's shaft, m.
    #[must_use]
    pub fn needle_diameter_m(&self) -> Option<f64> {
        match &self.kind {
            InstrumentKind::Needle(needle) => Some(needle.diameter.get()),
            _ => None,
        }
    }

    /// The needle, where it is one.
    #[must_use]
    pub fn needle(&self) -> Option<&Needle> {
        match &self.kind {
            InstrumentKind::Needle(needle) => Some(needle),
            _ => None,
        }
    }

    /// Whether it is a needle with friction, cutting and puncture.
    #[must_use]
    pub fn is_frictional(&self) -> bool {
        matches!(self.interaction, Interaction::Frictional { .. })
    }

    /// Lateral way (x, y) of the tip per metre of depth: zero for all but an oblique needle.
    #[must_use]
    pub fn slope(&self) -> [f64; 2] {
        match &self.kind {
            InstrumentKind::Needle(needle) => needle.slope(),
            InstrumentKind::Plate | InstrumentKind::Indenter { .. } => [0.0; 2],
        }
    }

    /// Unit vector along it, into the sample.
    #[must_use]
    pub fn axis(&self) -> [f64; 3] {
        let [x, y] = self.slope();
        let cosine = 1.0 / (1.0 + x * x + y * y).sqrt();
        [x * cosine, y * cosine, -cosine]
    }
}

/// Lower end of an indenter (`instrument.tip`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum IndenterTip {
    /// Flat.
    Flat,
    /// Half ball.
    Sphere,
}

/// Lower end of a needle (`instrument.tip`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NeedleTip {
    /// Cut across.
    Flat,
    /// A point on the axis.
    Conical,
    /// A point at the side: cut off at an angle.
    Bevel,
}

/// What the deformation coefficient multiplies (`instrument.deformation_rule`; `docs/method.md`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeformationRule {
    /// u_i = C_D (d - d_capture,i). The default.
    Incremental,
    /// u_i = C_D d.
    Absolute,
}

words!(IndenterTip: Flat = "flat", Sphere = "sphere");
words!(NeedleTip: Flat = "flat", Conical = "conical", Bevel = "bevel");
words!(DeformationRule: Incremental = "incremental", Absolute = "absolute");
