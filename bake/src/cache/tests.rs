use super::*;
use crate::diagnostic::BakeError;
use crate::scene::Origin;

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().expect("a folder"),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn session(&self) -> Session {
        Session::open(&self.path("cache"), &self.path("scene"), &self.path("out"))
    }

    /// Ends a session; returns what it did.
    fn finish(&self, session: Session, setting: &str) -> Report {
        let mut summary = Summary::default();
        session.finish(
            request(setting),
            &self.path("scene"),
            [],
            (&self.path("out"), [0; 32]),
            &mut summary,
        );
        summary.cache.expect("there is a cache")
    }
}

fn request(setting: &str) -> Inputs {
    Inputs::new(Kind::Package, "cairn_bake", "out").settings("setting", &setting)
}

fn inputs(name: &str, image: &[u8]) -> Inputs {
    Inputs::new(Kind::Texture, module_path!(), name).content("image", image)
}

/// Fetches; returns the product and whether it was made.
fn fetch(session: &Session, name: &str, image: &[u8]) -> (Vec<u8>, bool) {
    let mut made = false;
    let product = session.fetch(
        || inputs(name, image),
        || {
            made = true;
            Ok([image, b"!"].concat())
        },
    );
    (product.expect("it can be made"), made)
}

fn whys(report: &Report) -> Vec<(&str, bool, &str)> {
    let products = report.products.iter();
    products
        .map(|outcome| (outcome.name.as_str(), outcome.hit, outcome.why.as_str()))
        .collect()
}

#[test]
fn products_are_made_once_and_reasons_given() {
    let place = Bench::new();
    let first = place.session();
    assert_eq!(fetch(&first, "b", b"2"), (b"2!".to_vec(), true));
    assert_eq!(fetch(&first, "a", b"1"), (b"1!".to_vec(), true));
    let unknown = "no earlier bake of this output or scene is known";
    let report = place.finish(first, "");
    assert_eq!(
        whys(&report),
        [("a", false, unknown), ("b", false, unknown)]
    );

    let second = place.session();
    assert_eq!(fetch(&second, "a", b"1"), (b"1!".to_vec(), false));
    assert_eq!(fetch(&second, "b", b"3"), (b"3!".to_vec(), true));
    assert_eq!(fetch(&second, "c", b"4"), (b"4!".to_vec(), true));
    let report = place.finish(second, "");
    assert_eq!(
        whys(&report),
        [
            ("a", true, "unchanged"),
            ("b", false, "image changed"),
            ("c", false, "new since the last bake")
        ]
    );
    assert_eq!((report.hits, report.misses, report.problem), (1, 2, None));

    // What an earlier bake made is still there; what is gone or damaged is made again.
    let third = place.session();
    assert_eq!(fetch(&third, "b", b"2"), (b"2!".to_vec(), false));
    let store = Store::new(place.path("cache"));
    store.collect(0).expect("collected");
    assert_eq!(fetch(&third, "c", b"4"), (b"4!".to_vec(), true));
    let key = inputs("a", b"1").key();
    store.put(&key, b"no product").expect("stored");
    assert_eq!(fetch(&third, "a", b"1"), (b"1!".to_vec(), true));
    assert_eq!(
        whys(&place.finish(third, "")),
        [
            ("a", false, "its entry was damaged"),
            ("b", true, "made by another bake"),
            ("c", false, "its entry is gone from the cache")
        ]
    );
}

#[test]
fn errors_are_not_kept() {
    let place = Bench::new();
    for _ in 0..2 {
        let session = place.session();
        let failed: Result<Vec<u8>> = session.fetch(
            || inputs("a", b"1"),
            || Err(BakeError::input("test", &Origin::default(), "no")),
        );
        assert!(failed.is_err());
    }
    assert!(fetch(&place.session(), "a", b"1").1);
}

#[test]
fn a_cache_that_cannot_be_written_costs_time_only() {
    let place = Bench::new();
    std::fs::write(place.path("cache"), b"a file").expect("written");
    for _ in 0..2 {
        let session = place.session();
        assert!(fetch(&session, "a", b"1").1);
        let report = place.finish(session, "");
        assert!(report.problem.is_some());
    }
    assert!(fetch(&Session::off(), "a", b"1").1);
}

#[test]
fn numbers_come_back_bit_for_bit() {
    let place = Bench::new();
    let numbers = vec![
        0.1 + 0.2,
        f64::NAN,
        f64::INFINITY,
        -0.0,
        f64::MIN_POSITIVE / 8.0,
    ];
    let bits =
        |numbers: &[f64]| -> Vec<u64> { numbers.iter().map(|number| number.to_bits()).collect() };
    for _ in 0..2 {
        let made = numbers.clone();
        let found: Vec<f64> = place
            .session()
            .fetch(|| inputs("a", b"1"), || Ok(made))
            .expect("made");
        assert_eq!(bits(&found), bits(&numbers));
    }
}
