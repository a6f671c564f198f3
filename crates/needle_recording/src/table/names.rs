//! Words for time, position and force in headers: English and others of Europe, Chinese, Japanese, Korean.

/// Words for one quantity, in lower case.
pub(super) struct Words {
    words: &'static [&'static str],
    /// A word with this ending counts too: `Standardkraft`.
    ends: &'static [&'static str],
    /// A header that starts with this or contains it: words of a script without blanks.
    parts: &'static [&'static str],
}

pub(super) const TIME: Words = Words {
    words: &[
        "time",
        "t",
        "elapsed",
        "timestamp",
        "stamp",
        "date",
        "datetime",
        "x_value",
        "seconds",
        "millis",
        "micros",
        "zeit",
        "zeitstempel",
        "sekunden",
        "laufzeit",
        "datum",
        "uhrzeit",
        "temps",
        "durée",
        "tiempo",
        "tempo",
        "tijd",
        "время",
        "tid",
        "czas",
        "čas",
        "zaman",
        "aika",
        "idő",
        "timp",
    ],
    ends: &["zeit"],
    parts: &["时间", "時間", "时刻", "時刻", "시간"],
};
pub(super) const POSITION: Words = Words {
    words: &[
        "compression",
        "displacement",
        "position",
        "depth",
        "extension",
        "travel",
        "stroke",
        "indentation",
        "insertion",
        "crosshead",
        "lvdt",
        "encoder",
        "deflection",
        "pos",
        "disp",
        "displ",
        "ext",
        "weg",
        "traverse",
        "tiefe",
        "eindringtiefe",
        "verschiebung",
        "stauchung",
        "verformung",
        "dehnung",
        "eindringung",
        "course",
        "déplacement",
        "deplacement",
        "enfoncement",
        "profondeur",
        "allongement",
        "écrasement",
        "ecrasement",
        "pénétration",
        "penetration",
        "desplazamiento",
        "posición",
        "profundidad",
        "recorrido",
        "carrera",
        "posizione",
        "profondità",
        "posição",
        "profundidade",
        "curso",
        "hub",
        "corsa",
        "spostamento",
        "deslocamento",
        "verplaatsing",
        "перемещение",
        "деформация",
        "глубина",
        "ход",
        "extensión",
        "alargamiento",
        "compresión",
        "extensão",
        "alongamento",
        "allungamento",
        "schiacciamento",
        "positie",
        "przemieszczenie",
        "droga",
        "posunutí",
        "dráha",
        "förskjutning",
        "forskydning",
        "forskyvning",
        "siirtymä",
        "elmozdulás",
        "deplasare",
        "uzama",
        "deplasman",
    ],
    ends: &["weg", "tiefe"],
    parts: &["位移", "行程", "变形", "變形", "压缩量", "伸长", "位置", "深度", "変位", "深さ", "ストローク", "변위"],
};
pub(super) const FORCE: Words = Words {
    words: &[
        "force",
        "load",
        "loadcell",
        "fz",
        "f",
        "kraft",
        "last",
        "belastung",
        "effort",
        "charge",
        "fuerza",
        "carga",
        "forza",
        "carico",
        "força",
        "kracht",
        "siła",
        "síla",
        "kuvvet",
        "сила",
        "усилие",
        "нагрузка",
        "obciążenie",
        "zatížení",
        "voima",
        "erő",
        "forță",
        "yük",
    ],
    ends: &["kraft"],
    parts: &["力", "载荷", "荷载", "負荷", "负荷", "荷重", "负载", "하중"],
};
/// A header with such a word is a rate, a stress, a command or its error.
const OTHERS: [&str; 23] = [
    "rate",
    "speed",
    "velocity",
    "stress",
    "strain",
    "energy",
    "work",
    "setpoint",
    "target",
    "command",
    "commanded",
    "cmd",
    "demand",
    "desired",
    "error",
    "soll",
    "sollwert",
    "consigne",
    "geschwindigkeit",
    "spannung",
    "vitesse",
    "contrainte",
    "rpm",
];
const OTHER_PARTS: [&str; 4] = ["应力", "应变", "速度", "応力"];
/// A header with such a word is a size or a bound of the sample or of the test, whatever its unit.
const SIZES: [&str; 17] = [
    "diameter",
    "width",
    "height",
    "length",
    "thickness",
    "gap",
    "limit",
    "preload",
    "max",
    "min",
    "maximum",
    "minimum",
    "durchmesser",
    "breite",
    "höhe",
    "dicke",
    "vorkraft",
];

impl Words {
    /// How well a header names the quantity: 2 by its first word, 1 by another one, 0 not at all.
    pub(crate) fn rank(&self, header: &str) -> u8 {
        let header = apart(header.trim().trim_start_matches('"')).to_lowercase();
        let name = header.split(['(', '[', '<']).next().unwrap_or_default();
        let words: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
        let other =
            words.iter().any(|word| OTHERS.contains(word)) || OTHER_PARTS.iter().any(|part| name.contains(part));
        let is = |word: &&str| {
            let ends = self.ends.iter().any(|end| word.ends_with(end) && word.len() > end.len() + 1);
            self.words.contains(word) || ends
        };
        let whole = self.words.contains(&name.trim()) || self.parts.iter().any(|part| name.contains(part));
        match (other, whole || words.first().is_some_and(is), words.iter().any(is)) {
            (true, ..) | (_, false, false) => 0,
            (_, true, _) => 2,
            _ => 1,
        }
    }
}

/// A header with blanks between words that are joined by capitals, as `loadCell`. A single letter is no such word: that of `tMax` is not
/// the time.
fn apart(header: &str) -> String {
    let mut words = String::new();
    let mut rest = header;
    let joint = |w: &[u8]| w[0].is_ascii_lowercase() && w[1].is_ascii_uppercase() && w[2].is_ascii_lowercase();
    while let Some(at) = rest.as_bytes().windows(3).position(joint) {
        let (word, next) = rest.split_at(at + 1);
        let is_letter = word.chars().rev().nth(1).is_none_or(|before| !before.is_alphanumeric());
        words.push_str(if is_letter { &word[..at] } else { word });
        words.push(' ');
        rest = next;
    }
    words + rest
}

/// Whether a header says by its words that it is of something else than time, position and force, whatever its unit.
pub(super) fn is_other(header: &str) -> bool {
    let header = header.to_lowercase();
    let is = |word: &str| OTHERS.contains(&word) || SIZES.contains(&word);
    header.split(|c: char| !c.is_alphanumeric()).any(is) || OTHER_PARTS.iter().any(|part| header.contains(part))
}

/// Whether a cell names one of the quantities.
pub(super) fn is_known(cell: &str) -> bool {
    [&TIME, &POSITION, &FORCE].iter().any(|words| words.rank(cell) > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_many_languages() {
        for (words, headers) in [
            (
                &TIME,
                &[
                    "Time (s)",
                    "Test time",
                    "Prüfzeit",
                    "Zeit [s]",
                    "temps (s)",
                    "时间(s)",
                    "X_Value",
                    "t",
                    "Seconds",
                    "Время, с",
                ][..],
            ),
            (
                &POSITION,
                &[
                    "Crosshead travel",
                    "Standardweg",
                    "Déplacement (mm)",
                    "位移/mm",
                    "横梁位移",
                    "depth_mm",
                    "Position (z), mm",
                    "pos [mm]",
                    "Verformung",
                    "Перемещение (мм)",
                    "zPosition_mm",
                    "Przemieszczenie",
                ],
            ),
            (
                &FORCE,
                &[
                    "Standard force",
                    "Standardkraft",
                    "Kraft in N",
                    "Last",
                    "force_n",
                    "试验力(N)",
                    "荷载",
                    "F [N]",
                    "Fz, gf",
                    "Load / N",
                    "Нагрузка, Н",
                    "loadCell_mN",
                ],
            ),
        ] {
            for header in headers {
                assert!(words.rank(header) > 0, "{header}");
                let others = [&TIME, &POSITION, &FORCE].into_iter().filter(|other| !std::ptr::eq(*other, words));
                assert!(others.map(|other| other.rank(header)).all(|rank| rank < 2), "{header}");
            }
        }
        for header in [
            "Engineering Stress (kPa)",
            "Load rate",
            "Extension speed",
            "State",
            "Kommentar",
            "力学应力",
            "Soll-Position (mm)",
            "Position error",
            "tMax",
        ] {
            assert_eq!([TIME.rank(header), POSITION.rank(header), FORCE.rank(header)], [0; 3], "{header}");
        }
    }
}
