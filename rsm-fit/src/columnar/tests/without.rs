//! A build without the formats.

use super::*;
use crate::content::Content;

#[test]
fn a_build_without_a_format_names_its_feature() {
    let path = std::env::temp_dir().join(format!("rsm-columnar-without-{}", std::process::id()));
    let known: [(&[u8], &str, &str); 3] = [
        (b"PAR1 and more", "a Parquet file", "parquet"),
        (b"ARROW1", "an Arrow file", "arrow"),
        (b"\xff\xff\xff\xff\x10\0\0\0", "an Arrow stream", "arrow"),
    ];
    for (bytes, words, feature) in known {
        std::fs::write(&path, bytes).unwrap();
        let said = Content::read(&path).unwrap().table(&Wanted::default()).unwrap_err().to_string();
        let (file, expected) = (path.display(), format!("is {words}, which this build does not read"));
        assert!(said.starts_with(&format!("{file}: {expected}\n  help: build it with `--features {feature}`")), "{said}");
    }
    std::fs::remove_file(&path).unwrap();
}
