//! Settings of the texture encoders.

use std::fmt;
use std::str::FromStr;

use serde::Serialize;

use super::MipFilter;

/// Effort of the BC7, BC6H and UASTC encoders. BC5 and BC4 have one setting, a search over f32 texels.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Default,
    Serialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Quality {
    Fast,
    #[default]
    Default,
    Best,
}

impl Quality {
    /// From the cheapest up.
    pub const ALL: [Self; 3] = [Self::Fast, Self::Default, Self::Best];

    /// As the command line and reports have it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Default => "default",
            Self::Best => "best",
        }
    }
}

/// How hard the encoders try: a preset, or the cheapest preset of each texture whose level 0 reaches a PSNR.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
pub enum Effort {
    Preset(Quality),
    /// Of the stored values, in hundredths of a decibel.
    AtLeast {
        centibel: u32,
    },
}

impl Default for Effort {
    fn default() -> Self {
        Self::Preset(Quality::Default)
    }
}

impl From<Quality> for Effort {
    fn from(quality: Quality) -> Self {
        Self::Preset(quality)
    }
}

impl Effort {
    /// The PSNR asked for, decibels.
    pub fn target_db(self) -> Option<f64> {
        match self {
            Self::Preset(_) => None,
            Self::AtLeast { centibel } => Some(f64::from(centibel) / 100.0),
        }
    }
}

impl fmt::Display for Effort {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Preset(quality) => out.write_str(quality.name()),
            Self::AtLeast { centibel } => write!(out, "{}dB", f64::from(*centibel) / 100.0),
        }
    }
}

impl FromStr for Effort {
    type Err = String;

    /// `fast`, `default`, `best`, or decibels such as `42dB`.
    fn from_str(text: &str) -> Result<Self, String> {
        let preset = Quality::ALL
            .into_iter()
            .find(|quality| quality.name() == text);
        if let Some(quality) = preset {
            return Ok(quality.into());
        }
        let number = ["dB", "db", "DB"]
            .iter()
            .find_map(|unit| text.strip_suffix(unit));
        let decibels: Option<f64> = number.and_then(|number| number.trim().parse().ok());
        match decibels {
            Some(decibels) if (1.0..=99.0).contains(&decibels) => Ok(Self::AtLeast {
                centibel: (decibels * 100.0).round() as u32,
            }),
            Some(_) => Err("a target lies between 1dB and 99dB".into()),
            None => Err(format!(
                "`{text}` is neither fast, default, best nor a target such as 42dB"
            )),
        }
    }
}

/// Which encoders run.
#[derive(
    rkyv::Archive,
    rkyv::Serialize,
    rkyv::Deserialize,
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Hash,
    Default,
    Serialize,
)]
#[serde(rename_all = "lowercase")]
pub enum Kernels {
    /// Our own encoders, whose arithmetic leaves processors no choice: the same bytes on every machine.
    #[default]
    Reproducible,
    /// The ISPC kernels of BC7 for this machine. Their reciprocals are approximate, and differ even between vendors
    /// of one instruction set: the bytes depend on the CPU.
    Native,
}

/// What the texels are stored for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Target {
    /// GPUs that read BC formats, which every desktop GPU does.
    #[default]
    Desktop,
    /// Any GPU: UASTC, which the player transcodes while it loads.
    Portable,
    /// No block compression: 8 bits a channel, 16 for normals. Four to eight times the bytes, for pictures that serve as
    /// references.
    Uncompressed,
}

impl Target {
    /// As the command line has it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Desktop => "desktop",
            Self::Portable => "portable",
            Self::Uncompressed => "uncompressed",
        }
    }
}

/// Settings of `encode`; all of them, the role and the source decide the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default, Serialize)]
pub struct EncodeOptions {
    pub effort: Effort,
    pub filter: MipFilter,
    pub kernels: Kernels,
    /// Whether the alpha of masked textures is only filtered: coverage then falls with distance.
    pub plain_alpha: bool,
    /// Whether the length that averaged normals lose becomes roughness.
    pub toksvig: bool,
    pub target: Target,
}

impl EncodeOptions {
    /// Name and value of every setting, as flags have them, for a package's provenance.
    pub fn provenance(&self) -> Vec<(&'static str, String)> {
        let mut settings = vec![
            ("texture-quality", self.effort.to_string()),
            ("mip-filter", self.filter.name().into()),
        ];
        if self.target != Target::Desktop {
            settings.push(("target", self.target.name().into()));
        }
        if self.kernels == Kernels::Native {
            settings.push(("native-isa", native_isa().into()));
        }
        if self.plain_alpha {
            settings.push(("plain-alpha", "on".into()));
        }
        if self.toksvig {
            settings.push(("toksvig", "on".into()));
        }
        settings
    }
}

/// The instruction set for which native kernels are chosen on this machine.
pub fn native_isa() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if std::is_x86_feature_detected!("avx512vl") {
            return "avx512";
        }
        if std::is_x86_feature_detected!("avx2") {
            return "avx2";
        }
        if std::is_x86_feature_detected!("avx") {
            return "avx";
        }
    }
    "baseline"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn efforts_are_read_and_written() {
        for (text, effort) in [
            ("fast", Effort::Preset(Quality::Fast)),
            ("default", Effort::default()),
            ("best", Effort::Preset(Quality::Best)),
            ("42dB", Effort::AtLeast { centibel: 4200 }),
            ("38.25dB", Effort::AtLeast { centibel: 3825 }),
        ] {
            assert_eq!(text.parse(), Ok(effort));
            assert_eq!(effort.to_string(), text);
        }
        assert_eq!("42.5db".parse::<Effort>().unwrap().target_db(), Some(42.5));
        for text in ["", "42", "dB", "slow", "0dB", "120dB", "NaNdB", "-3dB"] {
            assert!(text.parse::<Effort>().is_err(), "{text}");
        }
    }

    #[test]
    fn only_what_differs_from_reproducible_is_marked() {
        let plain = EncodeOptions::default().provenance();
        assert!(plain.iter().all(|(name, _)| *name != "native-isa"));
        let native = EncodeOptions {
            kernels: Kernels::Native,
            ..EncodeOptions::default()
        };
        let names: Vec<&str> = native
            .provenance()
            .iter()
            .map(|setting| setting.0)
            .collect();
        assert_eq!(names, ["texture-quality", "mip-filter", "native-isa"]);
    }
}
