//! Recordings as strangers bring them: what is said of each, with which exit code. The test prints the whole table
//! (`cargo test --release --test programs strangers -- --nocapture`). What is live is in `tests/ros/strangers.rs`.
#![allow(clippy::unwrap_used, clippy::panic)]

mod records;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::time::Instant;

use assert_cmd::Command;
use encoding_rs::{GBK, IBM866, KOI8_R, SHIFT_JIS, WINDOWS_1250, WINDOWS_1251};
use tempfile::TempDir;

/// What must come of a command. `@` in its words stands for the folder of tables that the test makes; words after a `!` must
/// not be said.
struct Case {
    row: u8,
    command: &'static str,
    code: i32,
    says: &'static [&'static str],
}

const fn case(row: u8, command: &'static str, code: i32, says: &'static [&'static str]) -> Case {
    Case { row, command, code, says }
}

/// 125 readings of 2.48 mm in 12.4 s, to 3.0752 N.
const ALL: &[&str] = &[
    "depth  125 readings from 0.000 to 12.400 s, from 0.000000 to 0.002480 m",
    "force  125 readings from 0.000 to 12.400 s, from 0.000000 to 3.075200 N",
];
const DEPTHS: &[&str] = &["depth  125 readings from 0.000 to 12.400 s, from 0.000000 to 0.002480 m"];
/// 40 readings of 0.78 mm in 3.9 s, to 0.0039 N.
const FORTY: &[&str] = &["depth  40 readings from 0.000 to 3.900 s, from 0.000000 to 0.000780 m", "to 0.003900 N"];
const EXPLAINED: &[&str] =
    &["1640 answered", "rmse 0.0023 N (0.3% of the measured peak)", "the model explains the measurement"];

const TABLES: &[Case] = &[
    case(1, "import tables/state_column.csv", 0, ALL),
    case(1, "import tables/iso_timestamp.csv", 0, ALL),
    case(1, "import tables/date_and_time.csv", 0, ALL),
    case(1, "import tables/marker_in_row_1.csv", 0, ALL),
    case(1, "import tables/topic_echo.csv --time 1 --position 5 --position-unit m", 0, DEPTHS),
    case(1, "import @/state_first.csv", 0, FORTY),
    case(1, "import @/american.csv", 0, FORTY),
    case(1, "import @/midnight.csv", 0, FORTY),
    case(1, "import @/stamps.csv", 0, FORTY),
    case(1, "import @/when.csv", 0, FORTY),
    case(1, "import @/basic.csv", 0, FORTY),
    case(1, "import @/underscore.csv", 0, FORTY),
    case(1, "import @/points.csv", 0, FORTY),
    case(1, "import @/pandas.csv", 0, FORTY),
    case(1, "import @/brackets.csv", 0, FORTY),
    case(1, "import @/serial.csv --time-unit d", 0, FORTY),
    case(1, "import @/serial.csv", 1, &["no unit stands in the header `Date`", "--time-unit"]),
    case(1, "import @/weekday.csv", 0, FORTY),
    case(1, "import @/zone.csv", 0, FORTY),
    case(1, "import @/points_of_time.csv", 0, FORTY),
    case(1, "import @/day_and_seconds.csv", 0, FORTY),
    case(1, "import @/midnights.csv", 0, FORTY),
    case(1, "import @/no_time.csv", 3, &["1 messages left out", "line 22", "depth  39", "force  39"]),
    case(1, "import @/newest.csv", 0, FORTY),
    case(1, "import @/epoch.csv", 0, &["in ms", "depth  40 readings from 0.000 to 3.900 s"]),
    case(
        2,
        "import tables/word_in_row_2.csv --header-line 1",
        3,
        &["1 messages left out", "line 3", "OVER", "depth  125", "force  124"],
    ),
    case(2, "import tables/word_in_row_2.csv", 3, &["line 3", "OVER", "depth  125", "force  124"]),
    case(2, "import @/word_in_row_1.csv --header-line 1", 3, &["line 2", "OVER", "depth  40", "force  39"]),
    case(2, "import @/two_columns.csv --rate-hz 10", 3, &["line 3", "OVER", "depth  40", "force  39"]),
    case(2, "import @/last_word.csv", 3, &["line 41", "OVER", "depth  40", "force  39"]),
    case(
        2,
        "import @/killed.csv",
        3,
        &["1 messages left out", "line 41: 3.9 | 0.7 (cut off before column 3)", "depth  39", "force  39"],
    ),
    case(2, "import @/killed_behind_separator.csv", 3, &["line 41", "(cut off before column 3)", "depth  39"]),
    case(
        2,
        "import @/short_in_the_middle.csv",
        3,
        &["line 22: 2.0 (cut off before column 2)", "depth  39", "force  39"],
    ),
    case(2, "import @/force_at_half_rate.csv", 0, &["depth  40", "force  20"]),
    case(2, "import @/force_at_half_rate_without_separators.csv", 0, &["depth  40", "force  20"]),
    case(2, "import @/comment_in_some_rows.csv", 0, FORTY),
    case(
        3,
        "import tables/state_column.csv --force-column Laod",
        1,
        &["--force-column Laod: there is no such column", "`Force (N)`"],
    ),
    case(3, "import tables/state_column.csv --time When", 1, &["--time When: there is no such column"]),
    case(3, "import tables/state_column.csv --pose-columns x,y,z", 1, &["--pose-columns x: there is no such column"]),
    case(3, "import @/twice.csv --force Load", 1, &["2 columns have the header `Load`", "number", "3"]),
    case(3, "import @/twice.csv --force 4 --force-unit N", 0, FORTY),
    case(4, "import tables/labview.lvm", 0, ALL),
    case(4, "import tables/labview_comment_in_row_1.lvm", 0, ALL),
    case(4, "import tables/trailing_separator_in_headers.csv", 0, ALL),
    case(4, "import tables/trailing_separator_in_rows.csv", 0, ALL),
    case(4, "import tables/zwick_cells_beside.csv", 0, ALL),
    case(4, "import tables/zwick_german.csv", 0, ALL),
    case(4, "import tables/thousands.csv", 0, ALL),
    case(4, "import @/gbk.csv", 0, FORTY),
    case(4, "import @/french.csv", 0, FORTY),
    case(4, "import @/last.csv", 0, FORTY),
    case(4, "import @/untitled.csv", 0, FORTY),
    case(4, "import @/words.csv", 0, FORTY),
    case(4, "import @/numbered.csv", 0, FORTY),
    case(4, "import @/channels.lvm", 0, FORTY),
    case(4, "import @/drawn.txt", 0, FORTY),
    case(4, "import @/returns.csv", 0, FORTY),
    case(4, "import @/fortran.dat", 0, FORTY),
    case(4, "import @/units_in_cells.csv", 0, FORTY),
    case(4, "import @/another_unit.csv", 3, &["1 messages left out", "line 31", "depth  39", "force  39"]),
    case(4, "import @/russian.csv", 0, FORTY),
    case(4, "import @/windows_1251.csv", 0, FORTY),
    case(4, "import @/koi8.csv", 0, FORTY),
    case(4, "import @/dos.csv", 0, FORTY),
    case(4, "import @/japanese.csv", 0, FORTY),
    case(4, "import @/r.csv", 0, FORTY),
    case(4, "import @/minus.csv", 0, FORTY),
    case(4, "import @/excel.csv", 0, FORTY),
    case(4, "import @/lines.csv", 0, FORTY),
    case(4, "import @/units_above.csv", 0, FORTY),
    case(4, "import @/dashes.csv", 0, FORTY),
    case(4, "import @/units_alone.csv", 0, FORTY),
    case(4, "import @/counter.csv", 0, FORTY),
    case(4, "import @/long_head.csv", 0, FORTY),
    case(4, "import @/long_head.csv --header-line 601", 0, FORTY),
    case(4, "import @/strain.csv", 0, FORTY),
    case(4, "import @/only_strain.csv --gauge-length-m 0.02", 0, FORTY),
    case(4, "import @/only_strain.csv", 1, &["`Dehnung (%)`", "--gauge-length-m"]),
    case(4, "import @/swedish.csv", 0, FORTY),
    case(4, "import @/polish.csv --time-unit s --position-unit mm --force-unit N", 0, FORTY),
    case(4, "import @/soll.csv", 0, FORTY),
    case(4, "import @/joined.csv", 0, FORTY),
    case(4, "import @/centinewton.csv", 0, FORTY),
    case(4, "import @/pounds.csv", 0, FORTY),
    case(4, "import @/two_forces.csv", 0, &["4 `Axis B (N)` are forces by their units", "--force"]),
    case(
        5,
        "import tables/mach1_three_blocks.txt",
        1,
        &["several recordings", "--block N", "2 is lines 317 to 816 (500 rows)", "3 is lines 823"],
    ),
    case(5, "import @/results.csv", 0, FORTY),
    case(5, "import @/results.csv", 0, &["the table from line 4 on has no times; that from line 9 on is taken"]),
    case(5, "import @/results_below.csv", 0, FORTY),
    case(5, "import @/results_below.csv", 0, &["(3 rows) have no times and were left out"]),
    case(5, "import tables/mach1_three_blocks.txt --block 1", 0, &["300 readings from 0.000 to 2.990 s"]),
    case(5, "import tables/mach1_three_blocks.txt --block 2", 0, &["500 readings from 0.000 to 4.990 s"]),
    case(5, "import tables/mach1_three_blocks.txt --block 3", 0, &["300 readings from 0.000 to 2.990 s"]),
    case(5, "import tables/mach1_three_blocks.txt --block 4", 1, &["no such block"]),
    case(
        5,
        "import @/again.csv",
        1,
        &["several recordings", "1 is lines 2 to 41 (40 rows), 2 is lines 43 to 82 (40 rows)"],
    ),
    case(5, "import @/again.csv --block 2", 0, FORTY),
    case(5, "import @/anew.csv", 1, &["several recordings", "2 is lines 42 to 81 (40 rows)"]),
    case(5, "import @/anew.csv --block 2", 0, FORTY),
    case(6, "import @/zero_stamp.csv", 3, &["1 messages left out", "depth  39 readings from 0.000 to 3.900 s"]),
    case(
        6,
        "import tables/whole_seconds.csv",
        0,
        &["112 readings have the stamp of another: they were spread", "depth  125", "0.000 to 12.400 s"],
    ),
    case(6, "import @/milliseconds.csv --time-unit s", 1, &["no time", "--time-unit"]),
    case(6, "import @/milliseconds.csv --time-unit ms", 0, FORTY),
    case(6, "import @/one_stamp.csv", 3, &["39 messages left out", "all have one stamp"]),
    case(
        7,
        "import @/counts.csv --position Encoder --position-unit mm --position-scale 0.001 --position-zero 50000",
        0,
        FORTY,
    ),
    case(7, "import @/end.csv --position-sign -1 --position-zero 30", 0, FORTY),
    case(7, "import @/encoder.csv --position Counts", 1, &["no unit", "an encoder's counts", "--position-scale"]),
    case(8, "import @/vector.csv --force-columns Fx,Fy,Fz --sensor-rotation 0.70710678,0,-0.70710678,0", 0, FORTY),
    case(8, "import @/vector.csv --force-columns Fx,Fy,Nz", 1, &["--force-columns Nz: there is no such column"]),
    case(
        8,
        "import @/vector.csv --force-columns Fx,Fy,Fz --sensor-rotation 0,0,0,0",
        1,
        &["--sensor-rotation", "norm 1"],
    ),
    case(
        8,
        "import @/pose.csv --pose-columns x,y,z,qx,qy,qz,qw --sample-pose 0.4,-0.1,0.3,0,0,0,1",
        0,
        &["tip's z  40 readings", "from 0.016220 to 0.017000 m"],
    ),
    case(8, "import tables/state_column.csv --sample-pose 0,0,0,0,0,0,1", 1, &["--sample-pose", "depths"]),
    case(9, "import @/old.bag", 1, &["a ROS 1 bag", "rosbags-convert"]),
    case(9, "import @/old.db3", 1, &["sqlite3", "rosbags-convert"]),
    case(9, "import @/old.mat", 1, &["MATLAB", "writetable", "scipy.io", "simplify_cells"]),
    case(9, "import @/new.mat", 1, &["version 7.3", "h5py", "visititems", ".T)"]),
    case(9, "import @/daq.dat", 1, &["a TDMS file", "nptdms", "chr(39)"]),
    case(9, "import @/old.xls", 1, &["spreadsheet", "xlrd", "read_excel", "to_csv"]),
    case(9, "import @/old.npz", 1, &["no archive of NumPy"]),
    case(9, "import @/old.xlsx", 1, &["can't be opened", "without a password", "CSV"]),
    case(9, "import @/text.xls", 0, FORTY),
    case(9, "import @/page.xls", 1, &["a page of HTML", "read_html"]),
    case(
        9,
        "import @/lines.json --position d --position-unit mm --time-unit s --force-unit N",
        0,
        &["JSON, 3 columns", "depth  2"],
    ),
    case(9, "import @/lines.jsonl", 0, FORTY),
    case(9, "import @/list.json", 0, FORTY),
    case(9, "import @/columns.json", 0, FORTY),
    case(
        9,
        "import @/killed.jsonl",
        3,
        &["1 messages left out", "line 40: {\"time_s\": 3.9", "depth  39", "force  39"],
    ),
    case(9, "import @/nan.jsonl", 3, &["1 messages left out", "NaN", "depth  40", "force  39"]),
    case(
        9,
        "import @/topics.jsonl --position-unit mm --force-unit N --force-columns /cell.wrench.force.x,/cell.wrench.force.y,/cell.wrench.force.z",
        0,
        FORTY,
    ),
    case(
        9,
        "import @/topics.jsonl --position-unit mm",
        1,
        &["several columns could be the force", "--force-columns X,Y,Z"],
    ),
    case(
        9,
        "import @/echo.yaml --position-unit mm",
        0,
        &["as of `ros2 topic echo`", "depth  40 readings from 0.000 to 3.900 s"],
    ),
    case(9, "import @/plotter.txt", 0, FORTY),
    case(9, "import @/monitor.txt", 0, FORTY),
    case(9, "import @/book.xml", 0, FORTY),
    case(
        9,
        "import @/book.xls",
        0,
        &["sheet `Gel 7`", "`Gel 8` hold numbers as well", "depth  40 readings from 0.000 to 3.900 s"],
    ),
    case(9, "import @/book.xls --sheet Gel_9", 1, &["no such sheet", "`Notes`, `Gel 7`, `Gel 8`"]),
    case(9, "import @/samples.xml", 1, &["an XML file", "read_xml"]),
    case(9, "import @/pointer.csv", 1, &["Git LFS", "git lfs pull"]),
    case(9, "import @/packed.zip", 1, &["an archive: unpack it", "!read_excel"]),
    case(9, "import @/empty.csv", 1, &["it is empty"]),
    case(4, "import @/millis.csv", 0, &["in millis", "depth  40 readings from 0.000 to 3.900 s", "to 0.0039"]),
    case(4, "import @/mojibake.csv", 0, FORTY),
    case(4, "import @/nul.csv", 0, FORTY),
    case(4, "import @/row_names.csv", 0, FORTY),
    case(5, "import @/pages.csv", 0, FORTY),
    case(5, "import @/pages.csv", 0, &["the headers stand again on line 24", "one recording"]),
    case(5, "import @/page_of_two_lost.csv", 3, &["1 messages left out", "line 24: 2.0 | OVER", "depth  40"]),
    case(5, "import @/later.csv", 1, &["several recordings", "--block N"]),
    case(
        2,
        "import @/gaps.txt",
        0,
        &["depth  40", "force  20 readings from 0.000 to 3.800 s, from 0.000000 to 0.003800 N"],
    ),
    case(2, "import @/one_gap.txt", 3, &["line 32: 3.000 | 0.600 | 21.0", "depth  39", "to 0.003900 N"]),
    case(2, "import @/one_gap_of_one_width.txt", 3, &["line 32: 3.000 | 0.600 | 21.000", "depth  39", "to 0.003900 N"]),
    case(2, "import @/nan.csv", 0, &["`NaN` in column 3 is taken for no reading", "depth  40", "force  20"]),
    case(2, "import @/na.csv", 0, &["`#N/A` in column 3", "depth  40", "force  20"]),
    case(2, "import @/dashes_for_none.csv", 0, &["`--` in column 3", "depth  40", "force  20"]),
    case(2, "import @/one_nan.csv", 3, &["1 messages left out", "line 22", "depth  40", "force  39"]),
    case(4, "import @/commas_twice.csv", 1, &["between commas", "decimal commas", "semicolons"]),
    case(4, "import @/commas_twice.csv --header-line 1", 1, &["decimal commas", "semicolons"]),
    case(6, "import @/set_back.csv", 3, &["200 messages left out", "step back by more than a second", "--rate-hz"]),
    case(6, "import @/set_back.csv --rate-hz 10", 0, &["depth  400 readings from 0.000 to 39.900 s"]),
    case(9, "import @/renamed.csv", 1, &["such a spreadsheet under another name", "read_excel"]),
    case(9, "import @/renamed.dat", 1, &["an HDF5 file", "h5py"]),
    case(9, "import @/frame.feather", 1, &["an Arrow file", "read_feather"]),
    case(9, "import @/frame.pkl", 1, &["a pickle of Python", "read_pickle"]),
    case(9, "import @/packed.csv.gz", 1, &["it is compressed: unpack it (gunzip"]),
    case(9, "import @/picture.csv", 1, &["it is binary and no text", "CSV"]),
    case(9, "import tables/workbook.xlsx", 0, FORTY),
    case(
        9,
        "import tables/workbook.xlsx",
        0,
        &[
            "sheet `Gel 7`",
            "data from line 6",
            "`Gel 8` hold numbers as well: --sheet takes another",
            "column 3 `Depth (mm)`",
        ],
    ),
    case(9, "import tables/workbook.xlsx --sheet Gel_8", 1, &["no such sheet", "`Notes`, `Gel 7`, `Gel 8`"]),
    case(9, "import tables/workbook.xlsx --sheet Notes", 1, &["no rows of numbers"]),
    case(
        9,
        "import tables/dates_and_error.xlsx",
        3,
        &["line 9: error #DIV/0!", "depth  40", "force  39", "0.000 to 3.900 s"],
    ),
    case(9, "import tables/no_table.xlsx", 1, &["no sheet has rows of numbers", "`Sheet`", "--sheet"]),
    case(9, "import tables/state_column.csv --sheet Gel", 1, &["--sheet says nothing of"]),
    case(9, "import tables/arrays.npz", 0, FORTY),
    case(9, "import tables/arrays.npz", 0, &["`rate_hz`", "left out", "`operator`"]),
    case(9, "import tables/two_lengths.npz", 1, &["two tables", "--force-file"]),
    case(9, "import tables/fields.npy", 0, FORTY),
    case(
        9,
        "import tables/array.npy --time 1 --time-unit s --position 2 --position-unit mm --force 3 --force-unit N",
        0,
        FORTY,
    ),
    case(9, "import tables/array.npy", 1, &["--position", "1 `1`, 2 `2`, 3 `3`"]),
    case(9, "import tables/transposed.npy", 1, &["(3, 40)", ".T)"]),
    case(9, "import tables/array.npy --separator ;", 1, &["--separator says nothing of"]),
    case(1, "import @/none.csv", 1, &["none.csv: can't be read", "!bag"]),
    case(1, "import @/none --out @/made", 1, &["none: ", "Name a rosbag2 folder or an .mcap file"]),
    case(10, "import @/long.csv", 0, &["depth  300000 readings from 0.000 to 2999.990 s", "force  300000 readings"]),
    case(8, "import @/zero.csv --force-zero 4.5", 0, FORTY),
    case(8, "import @/zero.csv --force-zero 4.5,0,0", 1, &["--force-zero X,Y,Z says nothing of", "give one number"]),
    case(8, "import @/zeros.csv --force-columns Fx,Fy,Fz --force-zero -3,4.5,0.25", 0, FORTY),
    case(
        8,
        "import @/zeros.csv --force-columns Fx,Fy,Fz --force-zero 4.5",
        1,
        &["--force-zero with one number", "X,Y,Z"],
    ),
    case(8, "import @/depths.csv --force-zero 4.5", 1, &["--force-zero says nothing of a recording without a force"]),
];

const COARSE: &str = " --scene compression --set discretisation.spacing_m=0.003";
const BAGS: &[Case] = &[
    case(
        6,
        "replay bags/stamp_whole_s.mcap",
        0,
        &["1418 of 1640 messages have the stamp of the one before", "1640 answered", "rmse 0.0023 N"],
    ),
    case(11, "replay bags/cf_single_axis_nan.mcap", 0, EXPLAINED),
    case(11, "replay bags/cf_single_axis_nan.mcap", 0, &["does not measure along x and y", "z alone is used"]),
    case(12, "replay bags/sim_both.mcap", 0, EXPLAINED),
    case(
        12,
        "replay bags/both_unstamped_pub0.mcap",
        0,
        &["have no stamp", "recorded are used for all topics", "rmse 0.0023 N"],
    ),
    case(12, "replay bags/cf_tai.mcap", 0, &["37.000 s ahead", "--time-offset-s 37.000", "rmse 0.0023 N"]),
    case(12, "replay bags/cf_tai.mcap --time-offset-s 37", 0, EXPLAINED),
    case(
        12,
        "replay bags/cf_tai.mcap --time-offset-s -1",
        3,
        &["nothing in common", "--time-offset-s", "nothing was compared"],
    ),
    case(
        12,
        "replay @/way.csv --force-file @/cell.csv",
        3,
        &["nothing in common", "--time-offset-s", "(100.000 more puts"],
    ),
    case(12, "replay @/way.csv --force-file @/cell.csv --time-offset-s 100", 0, &["the model explains"]),
    case(12, "calibrate @/way.csv --force-file @/cell.csv --fit material.shear_modulus_pa", 1, &["--time-offset-s"]),
    case(2, "replay @/sentinel.csv", 0, &["1 of 600 forces are -9999 N", "leave it out"]),
    case(13, "replay @/stops.csv", 0, &["the force was recorded from 0.000 to 2.990 s", "nothing is compared"]),
    case(
        13,
        "replay bags/split_missing_middle",
        3,
        &[
            "split_missing_middle_1.mcap is not there",
            "(2.735 s) nothing was recorded",
            "no verdict on the whole: the recording has a hole",
            "!explains",
        ],
    ),
    case(14, "replay bags/reindexed", 0, EXPLAINED),
    case(14, "replay bags/renamed", 0, EXPLAINED),
    case(14, "replay bags/type_without_msg.mcap", 0, EXPLAINED),
    case(14, "replay bags/msgzstd", 0, EXPLAINED),
    case(14, "replay bags/msgzstd/compression_0.mcap", 0, EXPLAINED),
    case(14, "replay bags/bare/compression_0.mcap.zstd", 0, EXPLAINED),
    case(15, "replay bags/js_two_publishers.mcap", 0, EXPLAINED),
    case(15, "replay bags/js_two_publishers.mcap --joint gripper", 1, &["no joint `gripper` but", "gripper_left"]),
    case(16, "replay bags/cp_transform.mcap", 0, EXPLAINED),
    case(2, "replay @/position_drops_out.csv", 1, &["the positions jump to and fro", "a sensor that drops out"]),
    case(
        2,
        "replay @/force_drops_out.csv",
        3,
        &["the forces jump to and fro", "a cell that drops out", "does not explain"],
    ),
    case(16, "replay @/tree", 1, &["/tf", "poses of several frames, base, tip", "--joint"]),
    case(16, "replay @/tree --joint tip", 0, &["600 answered", "the model explains"]),
    case(16, "replay @/tree --joint tool", 1, &["/tf", "`base, tip`, and the tip is `tool`", "--joint"]),
    case(15, "replay @/two_zeros", 1, &["/measured_js", "two courses some 0.0004", "two nodes publish it", "remap"]),
    case(15, "replay @/standing", 1, &["/measured_js", "two nodes publish it"]),
    case(15, "replay @/two_alike", 0, &["1200 answered", "the model explains"]),
    case(15, "replay @/two_cells", 1, &["/measured_cf", "its forces jump to and fro", "two nodes publish it"]),
    case(
        15,
        "replay @/hum",
        0,
        &["/measured_cf", "its forces jump to and fro", "Hum at half of the rate", "the model explains"],
    ),
    case(12, "replay @/no_force", 3, &["/measured_cf", "has no message", "nothing to compare", "QoS"]),
    case(
        12,
        "replay @/clock_set_back",
        0,
        &["/measured_js: its stamps step back by more than a second", "are used for all topics", "600 answered"],
    ),
    case(7, "replay @/end_of_travel.csv", 1, &["never touched", "--position-zero -3.5"]),
    case(7, "replay @/datum.csv", 1, &["in the sample from the first reading on", "--position-zero 12.6"]),
    case(7, "calibrate @/datum.csv --fit material.shear_modulus_pa", 1, &["--position-zero 12.6"]),
    case(7, "replay @/height.csv", 1, &["the recorded depths fall", "--position-sign -1 and --position-zero 30"]),
    case(7, "replay @/height.csv --position-sign -1 --position-zero 30", 0, &["the model explains"]),
    case(7, "replay @/early.csv", 1, &["the sample is touched later", "--position-zero -1.3"]),
    case(7, "replay @/early.csv --position-zero -1.3", 0, &["the model explains"]),
    case(7, "replay @/off.csv", 3, &["touched at a recorded depth of 3.2"]),
    case(
        8,
        "replay @/beside.csv --force-columns Fx,Fy,Fz",
        1,
        &["30 degrees beside the instrument", "--sensor-rotation W,X,Y,Z (0.96593,0.25882,0.00000,0.00000"],
    ),
    case(
        8,
        "replay @/beside.csv --force-columns Fx,Fy,Fz --force-zero 0,4.5,-1 \
         --sensor-rotation 0.96593,0.25882,0,0",
        0,
        &["the model explains"],
    ),
    case(
        8,
        "calibrate @/loaded.csv --fit material.shear_modulus_pa",
        0,
        &["load_cell.offset_n = 4.5", "material.shear_modulus_pa = 16", "the model explains"],
    ),
    case(8, "replay @/turned.csv --force-columns Fx,Fy,Fz", 1, &["mainly along x", "--sensor-rotation"]),
    case(
        8,
        "replay @/loaded.csv",
        1,
        &["before the contact the load cell reads 4.5000 N", "--force-zero", "!explains"],
    ),
    case(8, "replay @/loaded.csv --force-zero 4.5", 0, &["the model explains", "rmse 0.0"]),
    case(
        8,
        "replay @/weight.csv --force-columns Fx,Fy,Fz",
        1,
        &["reads 1.2000,-0.4000,4.5000 N in the sample's frame", "weight of a tool", "--force-zero"],
    ),
    case(8, "replay @/weight.csv --force-columns Fx,Fy,Fz --force-zero 1.2,-0.4,4.5", 0, &["the model explains"]),
    case(
        8,
        "replay @/askew.csv --force-columns Fx,Fy,Fz",
        3,
        &["does not explain", "turned against the sample", "--sensor-rotation"],
    ),
    case(8, "replay @/upside_down.csv", 1, &["the sign of the force", "--force-sign -1"]),
    case(8, "replay @/upside_down.csv --force-sign -1", 0, &["the model explains"]),
    case(
        7,
        "replay @/encoder.csv --position Counts --position-unit mm",
        1,
        &["its numbers are whole, as of an encoder", "--position-unit mm --position-scale 0.001 of 1000 counts per mm"],
    ),
    case(
        7,
        "replay @/encoder.csv --position Counts --position-unit mm --position-scale 0.00005",
        1,
        &["in the sample from the first reading on", "--position-zero 83"],
    ),
    case(
        7,
        "replay @/encoder.csv --position Counts --position-unit mm --position-scale 0.00005 --position-zero 8388608",
        0,
        &["the model explains"],
    ),
];
const NEEDLE: &str = " --scene needle_insertion";
const POSES: &[Case] = &[
    case(17, "replay bags/cp_mm.mcap", 1, &["likely in mm", "--position-unit mm"]),
    case(17, "replay bags/cp_mm.mcap --position-unit mm", 0, &["rmse 0.0010 N", "the model explains"]),
    case(17, "replay bags/cp_mm.mcap --position-sign -1", 1, &["--position-sign -1 says nothing of poses"]),
    case(
        17,
        "replay bags/cp_mm.mcap --position-unit mm --sample-pose 0,0,-0.02,0,0,0,1",
        1,
        &["the frame of the poses is another", "with --sample-pose", "mm higher", "!--position-zero"],
    ),
    case(17, "replay bags/cp_world.mcap", 1, &["frame `world`", "--sample-pose"]),
    case(17, "replay bags/cp_world.mcap --frame-id world", 1, &["0.47 m beside the sample", "--sample-pose"]),
    case(
        17,
        "replay bags/cp_world.mcap --sample-pose 0.45,-0.12,0.3,0,0,0,1",
        0,
        &["rmse 0.0010 N", "the model explains"],
    ),
    case(17, "replay bags/cp_world.mcap --sample-pose 0.45,-0.12,0.335,1,0,0,0", 1, &["the instrument points up"]),
    case(
        17,
        "replay bags/cp_world.mcap --sample-pose 0.41,-0.12,0.3,0,0,0,1",
        1,
        &["40.0 mm beside", "there is no sample", "--sample-pose 0.0400,0.0000,0,0,0,0,1"],
    ),
    case(
        17,
        "replay bags/cp_world.mcap --sample-pose 0.44,-0.12,0.3,0,0,0,1",
        1,
        &["10.0 mm beside", "--sample-pose 0.0100,0.0000,0,0,0,0,1", "--set instrument.entry_x_m=0.0100"],
    ),
    case(
        17,
        "replay bags/cp_world.mcap --sample-pose 0.45,-0.12,0.317,0,0,0,1",
        1,
        &["goes from 0.0160 to 0.0270 m", "its origin at the top", "with --sample-pose", "!--position-zero"],
    ),
    case(
        17,
        "replay bags/cp_world.mcap --sample-pose 0.45,-0.12,0.335,0.70711,0,0,0.70711",
        1,
        &["lies across the sample", "frame of its poses is turned", "(-0.70711,0.00000,0.00000,0.70711 is the least"],
    ),
    case(
        17,
        "replay @/sideways.csv --pose-columns x,y,z,qx,qy,qz,qw",
        1,
        &["lies across the sample", "its x axis goes that way", "from the handle to the tip"],
    ),
    case(17, "replay bags/cp_world.mcap --gauge-length-m 0.1", 1, &["--gauge-length-m says nothing of a bag"]),
];
const CHECKS: &[Case] = &[
    case(18, "scene check meshes/overlap.toml", 0, &["ok", "30 x 30 x 20 mm"]),
    case(
        19,
        "scene check meshes/rat_mm.toml",
        0,
        &["the mesh is 6000 x 6000 x 4000 mm", "likely mm", "sample.mesh_unit_m = 0.001", "(then 6 x 6 x 4 mm)"],
    ),
    case(
        19,
        "scene check meshes/rat_mm.toml --set motion.depth_m=0.02",
        0,
        &["likely cm", "sample.mesh_unit_m = 0.01 (then 60 x 60 x 40 mm)"],
    ),
    case(
        19,
        "scene check meshes/rat_mm.toml --set sample.shape=outline --set discretisation.spacing_m=0.002",
        1,
        &["likely mm", "sample.mesh_unit_m = 0.001", "nodes"],
    ),
    case(19, "scene check meshes/mm.toml", 1, &["30.0000 m long", "likely mm", "mesh_unit_m = 0.001"]),
    case(19, "scene check meshes/yup.toml", 1, &["y is up", "z must be", "mesh.points"]),
    case(
        20,
        "calibrate bags/ramp_only_from_contact.mcap --scene compression --set discretisation.spacing_m=0.003 \
         --fit material.shear_modulus_pa",
        0,
        &["drift was left out", "--load-cell drift", "material.shear_modulus_pa = 16"],
    ),
    case(
        20,
        "calibrate @/bent.csv --scene compression --set discretisation.spacing_m=0.003 --fit material.shear_modulus_pa",
        0,
        &["drift was left out", "--load-cell drift", "material.shear_modulus_pa = 16", "; 95 % within"],
    ),
    case(
        20,
        "replay bags/stamp_whole_s.mcap --scene compression --set discretisation.spacing_m=0.003 \
         --set material.shear_modulus_pa=0.0015",
        1,
        &["material.shear_modulus_pa = 0.0015 Pa is likely meant in MPa", "Nothing was run"],
    ),
    case(
        21,
        "calibrate @/end_of_travel.csv --position-zero -3.3 --scene compression --set discretisation.spacing_m=0.003 \
         --fit material.shear_modulus_pa --out @/fitted",
        0,
        &["alignment  contact at a recorded depth of"],
    ),
    case(
        21,
        "replay @/end_of_travel.csv --position-zero -3.3 --scene @/fitted/scene.toml",
        0,
        &["taken out of the recording, as the scene says ([align])", "the model explains"],
    ),
    case(
        22,
        "replay bags/cp_mm.mcap --position-unit mm --scene needle_insertion --out @/report",
        0,
        &["report.html", "the model explains"],
    ),
    case(
        24,
        "replay bags/sim_both.mcap --scene compression --set discretisation.spacing_m=0.003",
        0,
        &["steps each and at most", "real-time factor", "us per step"],
    ),
    case(14, "bag check bags/reindexed", 0, &["sound"]),
    case(14, "bag check bags/renamed", 0, &["sound"]),
    case(14, "bag info bags/bare/compression_0.mcap.zstd", 0, &["Count: 1640"]),
    case(5, "batch @/blocks.toml --out @/batch", 0, &["3 recordings"]),
];

/// What must stand in files that are made or shipped; `@` as in [`Case`].
const FILES: &[(u8, &str, &[&str])] = &[
    (22, "@/report/report.html", &["class=\"verdict good\""]),
    (22, "@/report/force.svg", &["needle_insertion"]),
    (
        23,
        "crates/needle_twin_py/python/needle_twin/_needle_twin.pyi",
        &["\"mirrored\"", "def tune(", "def layers(", "predict:"],
    ),
    (23, "crates/needle_twin_py/src/twin.rs", &["fn __copy__", "fn __deepcopy__", "fn __reduce__"]),
];

/// Runs of `needle_twin` in the folder of the inputs.
fn run(command: &str, made: &Path) -> (i32, String) {
    let inputs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/strangers");
    let words = command.split_whitespace().map(|word| word.replace('@', made.to_str().unwrap()));
    let output = Command::new(env!("CARGO_BIN_EXE_needle_twin")).current_dir(inputs).args(words).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (output.status.code().unwrap_or(-1), text(&output.stderr) + &text(&output.stdout))
}

/// Tables of 40 readings, 0.02 mm and 0.1 mN each 0.1 s, and a press of a bag of this project at other zeros.
fn make(folder: &Path) {
    let write = |name: &str, text: &[u8]| fs::write(folder.join(name), text).unwrap();
    let rows = |row: &dyn Fn(u32, f64, f64, f64) -> String| -> String {
        (0..40).map(|i| row(i, f64::from(i) / 10.0, f64::from(i) * 0.02, f64::from(i) * 1e-4)).collect()
    };
    let plain = rows(&|_, t, d, f| format!("{t:.1},{d:.2},{f:.4}\n"));
    let head = "Time (s),Depth (mm),Load (N)\n";
    let over = |line: usize| {
        let mut lines: Vec<String> = plain.lines().map(str::to_owned).collect();
        let cut = lines[line].rfind(',').unwrap();
        lines[line].replace_range(cut + 1.., "OVER");
        lines.join("\n") + "\n"
    };
    let states = rows(&|i, t, d, f| format!("{},{t:.1},{d:.2},{f:.4}\n", if i < 20 { "APPROACH" } else { "INSERT" }));
    write("state_first.csv", format!("State,{head}{states}").as_bytes());
    let american = rows(&|i, _, d, f| format!("3/4/2026 10:15:{:02}.{} PM;{d:.2};{f:.4}\n", i / 10, i % 10));
    write("american.csv", format!("Date;Depth (mm);Load (N)\n{american}").as_bytes());
    let midnight = rows(&|i, _, d, f| {
        let s = (86_398 + i / 10) % 86_400;
        format!("{:02}:{:02}:{:02},{}\t{d:.2}\t{f:.4}\n", s / 3600, s / 60 % 60, s % 60, i % 10)
    });
    write("midnight.csv", format!("Time\tDepth (mm)\tLoad (N)\n{midnight}").as_bytes());
    let stamps = rows(&|i, _, d, f| format!("{},{},insertion,{d:.2},{f:.4}\n", 7 + i / 10, i % 10 * 100_000_000));
    write("stamps.csv", format!("header.stamp.sec,header.stamp.nanosec,name,depth_mm,force_n\n{stamps}").as_bytes());
    write("word_in_row_1.csv", format!("{head}{}", over(0)).as_bytes());
    write("last_word.csv", format!("{head}{}", over(39)).as_bytes());
    let killed = plain.trim_end_matches("8,0.0039\n");
    write("killed.csv", format!("{head}{killed}").as_bytes());
    write("killed_behind_separator.csv", format!("{head}{killed}8,").as_bytes());
    write("short_in_the_middle.csv", format!("{head}{}", plain.replace("2.0,0.40,0.0020", "2.0")).as_bytes());
    let half =
        rows(&|i, t, d, f| format!("{t:.1},{d:.2},{}\n", if i % 2 == 0 { String::new() } else { f.to_string() }));
    write("force_at_half_rate.csv", format!("{head}{half}").as_bytes());
    write("force_at_half_rate_without_separators.csv", format!("{head}{}", half.replace(",\n", "\n")).as_bytes());
    let comments = plain.replace("0.0020\n", "0.0020,now\n");
    write("comment_in_some_rows.csv", format!("Time (s),Depth (mm),Load (N),Comment\n{comments}").as_bytes());
    let two: String = over(1).lines().map(|line| line.split_once(',').unwrap().1.to_owned() + "\n").collect();
    write("two_columns.csv", format!("Depth (mm),Load (N)\n{two}").as_bytes());
    let twice = rows(&|_, t, d, f| format!("{t:.1},{d:.2},7,{f:.4}\n"));
    write("twice.csv", format!("Time (s),Depth (mm),Load,Load\n{twice}").as_bytes());
    write("gbk.csv", &GBK.encode(&format!("时间(s),位移(mm),试验力(N)\n{plain}")).0);
    let comma = plain.replace(',', ";").replace('.', ",");
    let french: Vec<u8> = format!("Temps (s);Déplacement (mm);Force (N)\n{comma}").chars().map(|c| c as u8).collect();
    write("french.csv", &french);
    write("last.csv", format!("Zeit;Weg;Last\ns;mm;N\n{comma}").as_bytes());
    write("again.csv", format!("{head}{plain}\n{plain}").as_bytes());
    write("anew.csv", format!("{head}{plain}{plain}").as_bytes());
    write("zero_stamp.csv", format!("{head}{}", plain.replace("\n2.0,", "\n0.0,")).as_bytes());
    let when = rows(&|i, _, d, f| {
        let (s, tenths) = (i / 10, i % 10);
        format!("2026-03-04T10:15:{s:02}.{tenths}+02:00,insertion,{d:.2},{f:.4}\n")
    });
    write("when.csv", format!("When,Joint,pos [mm],F [N]\n{when}").as_bytes());
    let stamped = |stamp: &dyn Fn(u32) -> String| rows(&|i, _, d, f| format!("{},{d:.2},{f:.4}\n", stamp(i)));
    let basic = stamped(&|i| format!("20260304T1015{:02}.{}0+0100", i / 10, i % 10));
    write("basic.csv", format!("Stamp,Depth (mm),Load (N)\n{basic}").as_bytes());
    let underscore = stamped(&|i| format!("20260304_1015{:02}.{}", i / 10, i % 10));
    write("underscore.csv", format!("Stamp,Depth (mm),Load (N)\n{underscore}").as_bytes());
    let points = stamped(&|i| format!("3/4/2026,1:15:{:02}.{} p. m.", i / 10, i % 10));
    write("points.csv", format!("Date,Time,Depth (mm),Load (N)\n{points}").as_bytes());
    let pandas = stamped(&|i| format!("0 days 00:00:{:04.1}00000", f64::from(i) / 10.0));
    write("pandas.csv", format!("Time,Depth (mm),Load (N)\n{pandas}").as_bytes());
    let brackets = stamped(&|i| format!("[10:15:{:04.1}]", f64::from(i) / 10.0));
    write("brackets.csv", format!("Time,Depth (mm),Load (N)\n{brackets}").as_bytes());
    let serial = stamped(&|i| format!("{:.11}", 46_085.0 + f64::from(i) / 864_000.0));
    write("serial.csv", format!("Date,Depth (mm),Load (N)\n{serial}").as_bytes());
    write("untitled.csv", format!("X_Value (s),Untitled 1 (mm),Untitled (N)\n{plain}").as_bytes());
    write("words.csv", format!("Seconds (seconds),Weg (Millimeters),荷载 (Newtons)\n{plain}").as_bytes());
    let numbered = rows(&|i, t, d, f| format!("{i},{t:.1},{d:.2},{f:.4}\n"));
    write("numbered.csv", format!(",{head}{numbered}").as_bytes());
    let channels = rows(&|_, t, d, f| format!("{t:.1}\t{d:.2}\t{t:.1}\t{f:.4}\n"));
    let channels_head = "LabVIEW Measurement\t\nX_Columns\tMulti\n***End_of_Header***\t\nY_Unit_Label\tmm\tmm\tN\n\
                         X0\t0\t\t0\n***End_of_Header***\t\t\t\nX_Value\tLVDT\tX_Value\tCell\tComment\n";
    write("channels.lvm", format!("{channels_head}{channels}").as_bytes());
    let drawn = rows(&|_, t, d, f| format!("| {f:.4} | {t:.1} | {d:.2} |\n"));
    write("drawn.txt", format!("| Load (N) | Time (s) | Depth (mm) |\n|----------|:---|---:|\n{drawn}").as_bytes());
    write("returns.csv", format!("{head}{plain}").replace('\n', "\r").as_bytes());
    let fortran = rows(&|_, t, d, f| format!("  {t:.1}D+00  {:.3}D-01  {:.2}D-03\n", 10.0 * d, 1e3 * f));
    write("fortran.dat", format!("  time(s)  depth(mm)  force(N)\n{fortran}").as_bytes());
    let own_units = rows(&|_, t, d, f| format!("{t:.1} s;{d:.2} mm;{f:.4} N\n"));
    write("units_in_cells.csv", format!("Time;Depth;Load\n{own_units}").as_bytes());
    let another = own_units.replace("0.58 mm", "580 um");
    write("another_unit.csv", format!("Time;Depth;Load\n{another}").as_bytes());
    write("russian.csv", format!("Время, с;Перемещение, мм;Нагрузка, Н\n{comma}").as_bytes());
    for (name, encoding) in [("windows_1251.csv", WINDOWS_1251), ("koi8.csv", KOI8_R), ("dos.csv", IBM866)] {
        write(name, &encoding.encode(&format!("Время, с;Перемещение, мм;Нагрузка, Н\n{comma}")).0);
    }
    write("japanese.csv", &SHIFT_JIS.encode(&format!("時間[秒],ストローク[mm],試験力[N]\n{plain}")).0);
    write("r.csv", format!("time.s,depth.mm,force.N\n{plain}").as_bytes());
    write("minus.csv", format!("{head}{}", plain.replace("\n2.0,0.40,0", "\n2.0,0.40,\u{2212}0")).as_bytes());
    let two_forces = rows(&|_, t, d, f| format!("{t:.1},{d:.2},{f:.4},{f:.4}\n"));
    write("two_forces.csv", format!("Time (s),Depth (mm),Axis A (N),Axis B (N)\n{two_forces}").as_bytes());
    let weekday = stamped(&|i| format!("Wed Mar  4 10:15:{:02}.{} 2026", i / 10, i % 10));
    write("weekday.csv", format!("Time,Depth (mm),Load (N)\n{weekday}").as_bytes());
    let zone = stamped(&|i| format!("2026-03-04 10:15:{:02}.{} CET", i / 10, i % 10));
    write("zone.csv", format!("Time,Depth (mm),Load (N)\n{zone}").as_bytes());
    let finnish = rows(&|i, _, d, f| format!("4.3.2026 10.15.{:02},{};{d:.2};{f:.4}\n", i / 10, i % 10));
    write("points_of_time.csv", format!("Aika;Siirtymä (mm);Voima (N)\n{finnish}").as_bytes());
    write("no_time.csv", format!("{head}{}", plain.replace("\n2.0,", "\n,")).as_bytes());
    let newest: String = plain.lines().rev().map(|line| format!("{line}\n")).collect();
    write("newest.csv", format!("{head}{newest}").as_bytes());
    let formulas = rows(&|_, t, d, f| format!("=\"{t:.1}\",=\"{d:.2}\",=\"{f:.4}\"\n"));
    write("excel.csv", format!("{head}{formulas}").as_bytes());
    write("lines.csv", format!("\"Time\n(s)\",\"Depth\n(mm)\",\"Load\n(N)\"\n{plain}").as_bytes());
    write("units_above.csv", format!("s,mm,N\nTime,Depth,Load\n{plain}").as_bytes());
    write("dashes.csv", format!("Time,Depth,Load\ns,mm,N\n-,-,-\n{plain}").as_bytes());
    write("units_alone.csv", format!("Gel 7\ns,mm,N\n{plain}").as_bytes());
    write("counter.csv", format!("Points, Elapsed Time , Disp, Load\n  , Sec , mm, N\n{numbered}").as_bytes());
    let long_head: String = (0..600).map(|i| format!("Setting {i},{i}\n")).collect();
    write("long_head.csv", format!("{long_head}{head}{plain}").as_bytes());
    let strain = rows(&|_, t, d, f| format!("{t:.1};{f:.4};{d:.2};{:.3}\n", 5.0 * d));
    write("strain.csv", format!("Prüfzeit;Kraft;Standardweg;Dehnung\ns;N;mm;%\n{strain}").as_bytes());
    let only_strain = rows(&|_, t, d, f| format!("{:.3};{t:.1};{f:.4}\n", 5.0 * d));
    write("only_strain.csv", format!("Dehnung;Prüfzeit;Kraft\n%;s;N\n{only_strain}").as_bytes());
    let day = rows(&|_, t, d, f| format!("2026-03-04,10:15:00,{t:.1},{d:.2},{f:.4}\n"));
    let midnights = rows(&|i, _, d, f| format!("2026-03-04 00:00:00,10:15:{:02}.{},{d:.2},{f:.4}\n", i / 10, i % 10));
    write("midnights.csv", format!("Date,Time,Depth (mm),Load (N)\n{midnights}").as_bytes());
    write("day_and_seconds.csv", format!("Date,Time,Elapsed {{s}},Depth {{mm}},Load {{N}}\n{day}").as_bytes());
    let latin = |text: &str| text.chars().map(|c| c as u8).collect::<Vec<u8>>();
    write("swedish.csv", &latin(&format!("Tid (s);Förskjutning (mm);Kraft (N)\n{comma}")));
    write("polish.csv", &WINDOWS_1250.encode(&format!("Czas;Przemieszczenie;Siła\n{comma}")).0);
    let soll = rows(&|_, t, d, f| format!("{t:.1};{:.2};{d:.2};{f:.4}\n", 1.0 + d));
    write("soll.csv", format!("Zeit (s);Soll-Position (mm);Ist-Position (mm);Kraft (N)\n{soll}").as_bytes());
    write("joined.csv", format!("timeStamp_s,zPosition_mm,loadCell_N\n{plain}").as_bytes());
    let scaled = |n: f64| rows(&|_, t, d, f| format!("{t:.1},{d:.2},{:.8}\n", f / n));
    write("centinewton.csv", format!("Time (s),Depth (mm),Load (cN)\n{}", scaled(0.01)).as_bytes());
    write("pounds.csv", format!("Time (s),Depth (mm),Load (lbs)\n{}", scaled(4.448_221_615)).as_bytes());
    let maxima = "1,0.0039,5.2\n2,0.0041,5.3\nMean,0.0040,5.25\n";
    let above = format!("Results\n,Maximum Load,Modulus\n,(N),(kPa)\n{maxima}\n{head}{plain}");
    write("results.csv", above.as_bytes());
    let below = format!("{head}{plain}\nSpecimen,Maximum Load (N),Modulus (kPa)\n{}", maxima.replace("Mean", "3"));
    write("results_below.csv", below.as_bytes());
    write("text.xls", format!("{head}{plain}").replace(',', "\t").as_bytes());
    write("page.xls", b"<html><table><tr><td>Time (s)</td></tr>\n</table></html>\n");
    write("lines.json", b"{\"t\": 0.0, \"d\": 0.0, \"f\": 0.0}\n{\"t\": 0.1, \"d\": 0.02, \"f\": 0.1}\n");
    let sideways: String = (0..200)
        .map(|i| {
            let t = f64::from(i) * 0.01;
            format!("{t:.2},0,0,{:.5},0,0.70711,0,0.70711,{:.4}\n", 0.018 - 0.005 * t, 0.01 * t)
        })
        .collect();
    write("sideways.csv", format!("Time (s),x (m),y (m),z (m),qx,qy,qz,qw,Load (N)\n{sideways}").as_bytes());
    let epoch = rows(&|i, _, d, f| format!("{},{d:.2},{f:.4}\n", 1_767_225_600_000_u64 + u64::from(i) * 100));
    write("epoch.csv", format!("timestamp,Depth (mm),Load (N)\n{epoch}").as_bytes());
    write("milliseconds.csv", format!("Time,Depth (mm),Load (N)\n{epoch}").as_bytes());
    let one = rows(&|_, _, d, f| format!("5,{d:.2},{f:.4}\n"));
    write("one_stamp.csv", format!("{head}{one}").as_bytes());
    let counts = rows(&|_, t, d, f| format!("{t:.1},{:.0},{f:.4}\n", 50_000.0 + 1000.0 * d));
    write("counts.csv", format!("Time (s),Encoder,Load (N)\n{counts}").as_bytes());
    let end = rows(&|_, t, d, f| format!("{t:.1},{:.2},{f:.4}\n", 30.0 - d));
    write("end.csv", format!("{head}{end}").as_bytes());
    let vector = rows(&|_, t, d, f| format!("{t:.1},{d:.2},{f:.4},0,0\n"));
    write("vector.csv", format!("Time (s),Depth (mm),Fx (N),Fy (N),Fz (N)\n{vector}").as_bytes());
    let pose = rows(&|_, t, d, f| format!("{t:.1},0.4,-0.1,{:.5},1,0,0,0,{f:.4}\n", 0.317 - 1e-3 * d));
    write("pose.csv", format!("Time (s),x (m),y (m),z (m),qx,qy,qz,qw,Load (N)\n{pose}").as_bytes());
    write("old.bag", b"#ROSBAG V2.0\n and more");
    write("old.db3", b"SQLite format 3\0 and more");
    write("old.mat", b"MATLAB 5.0 MAT-file");
    write("new.mat", b"MATLAB 7.3 MAT-file");
    write("daq.dat", b"TDSm\x0e\0\0\0\x69\x12");
    write("old.npz", b"PK");
    write("old.xlsx", b"PK");
    write("old.xls", b"PK");
    write("renamed.csv", b"PK\x03\x04\x14\0[Content_Types].xml and more");
    write("renamed.dat", b"\x89HDF\r\n\x1a\n\0\0");
    write("frame.feather", b"ARROW1\0\0");
    write("frame.pkl", b"\x80\x04\x95\0");
    write("packed.csv.gz", b"\x1f\x8b\x08\0\0");
    write("picture.csv", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR");
    let long: String =
        (0..300_000).map(|i| format!("{:.2},{:.4},{:.5}\n", f64::from(i) * 0.01, f64::from(i) * 1e-4, 1e-5)).collect();
    write("long.csv", format!("{head}{long}").as_bytes());
    let zero = rows(&|_, t, d, f| format!("{t:.1},{d:.2},{:.4}\n", 4.5 + f));
    write("zero.csv", format!("{head}{zero}").as_bytes());
    let zeros = rows(&|_, t, d, f| format!("{t:.1},{d:.2},-3,4.5,{:.4}\n", 0.25 + f));
    write("zeros.csv", format!("Time (s),Depth (mm),Fx (N),Fy (N),Fz (N)\n{zeros}").as_bytes());
    let depths = rows(&|_, t, d, _| format!("{t:.1},{d:.2}\n"));
    write("depths.csv", format!("Time (s),Depth (mm)\n{depths}").as_bytes());
    let mach1 = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/strangers/tables/mach1_three_blocks.txt");
    let manifest = format!(
        "[defaults]\nscene = \"compression\"\nset = [\"discretisation.spacing_m=0.004\"]\nfit = []\n[[recordings]]\nfile = {mach1:?}\n"
    );
    write("blocks.toml", manifest.as_bytes());
    // force over depth of the recorded press, in at 1 mm/s and out
    let press = |zero_mm: f64, cells: &dyn Fn(f64) -> String| -> String {
        let row = |i: u32| {
            let t = f64::from(i) * 0.01;
            let d = if t < 3.0 { t - 0.5 } else { 5.5 - t };
            let f = if d > 0.0 { 0.3116 * d + 0.0117 * d * d } else { 0.0 };
            format!("{t:.2},{:.4},{}\n", d + zero_mm, cells(f))
        };
        (0..600).map(row).collect()
    };
    let force = |f: f64| format!("{f:.5}");
    write("end_of_travel.csv", format!("{head}{}", press(-3.5, &force)).as_bytes());
    // a way in alone, of a sample that bends a little more than the model
    let bent = |i: u32| {
        let d = f64::from(i) * 0.004 - 0.8;
        let noise = 0.004 * (f64::from(i * 7919 % 101) / 50.0 - 1.0);
        let f = if d > 0.0 { 0.3116 * d + 0.0117 * d * d } else { 0.0 };
        format!("{:.2},{d:.4},{:.5}\n", f64::from(i) * 0.02, noise + f)
    };
    write("bent.csv", format!("{head}{}", (0..800).map(bent).collect::<String>()).as_bytes());
    let stops: String = press(0.0, &force)
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let end = line.rfind(',').unwrap() + 1;
            format!("{}\n", if i < 300 { line } else { &line[..end] })
        })
        .collect();
    write("stops.csv", format!("{head}{stops}").as_bytes());
    let pressed = press(0.0, &force);
    let column = |k: usize, late_s: f64| -> String {
        let cells = |line: &str| -> Vec<f64> { line.split(',').map(|cell| cell.parse().unwrap()).collect() };
        pressed.lines().map(cells).map(|row| format!("{:.2},{}\n", row[0] + late_s, row[k])).collect()
    };
    write("way.csv", format!("Time (s),Depth (mm)\n{}", column(1, 0.0)).as_bytes());
    write("cell.csv", format!("Time (s),Load (N)\n{}", column(2, 100.0)).as_bytes());
    let mut lines: Vec<&str> = pressed.lines().collect();
    lines[250] = "2.50,2.0000,-9999";
    write("sentinel.csv", format!("{head}{}\n", lines.join("\n")).as_bytes());
    write("early.csv", format!("{head}{}", press(-1.3, &force)).as_bytes());
    write("datum.csv", format!("{head}{}", press(12.7, &force)).as_bytes());
    let height = |line: &str| -> String {
        let cells: Vec<&str> = line.split(',').collect();
        format!("{},{:.4},{}\n", cells[0], 30.0 - cells[1].parse::<f64>().unwrap(), cells[2])
    };
    let height: String = press(0.0, &force).lines().map(height).collect();
    write("height.csv", format!("{head}{height}").as_bytes());
    write("off.csv", format!("{head}{}", press(3.2, &force)).as_bytes());
    // a sensor that is turned by 30 degrees about x, and reads 4.5 N without load
    let beside = press(0.0, &|f| format!("0,{:.5},{:.5}", 4.5 + 0.5 * f, 0.866_025 * f - 1.0));
    write("beside.csv", format!("Time (s),Depth (mm),Fx (N),Fy (N),Fz (N)\n{beside}").as_bytes());
    write("loaded.csv", format!("{head}{}", press(0.0, &|f| format!("{:.5}", 4.5 + f))).as_bytes());
    let x = press(0.0, &|f| format!("{f:.5},0.001,0.002"));
    let weight = press(0.0, &|f| format!("1.2,-0.4,{:.5}", 4.5 + f));
    write("weight.csv", format!("Time (s),Depth (mm),Fx (N),Fy (N),Fz (N)\n{weight}").as_bytes());
    // turned by 10 degrees, and by half a turn
    let askew = press(0.0, &|f| format!("0,{:.5},{:.5}", 0.173_648 * f, 0.984_808 * f));
    write("askew.csv", format!("Time (s),Depth (mm),Fx (N),Fy (N),Fz (N)\n{askew}").as_bytes());
    write("upside_down.csv", format!("{head}{}", press(0.0, &|f| format!("{:.5}", -f))).as_bytes());
    let counted = |line: &str| -> String {
        let cells: Vec<&str> = line.split(',').collect();
        let counts = 8_388_608.0 + (20_000.0 * cells[1].parse::<f64>().unwrap()).round();
        format!("{},{counts:.0},{}\n", cells[0], cells[2])
    };
    let encoder: String = press(0.0, &force).lines().map(counted).collect();
    write("encoder.csv", format!("Time (s),Counts,Load (N)\n{encoder}").as_bytes());
    write("turned.csv", format!("Time (s),Depth (mm),Fx (N),Fy (N),Fz (N)\n{x}").as_bytes());
}

#[test]
fn what_strangers_bring_is_read_or_refused_with_a_remedy() {
    let folder = TempDir::new().unwrap();
    make(folder.path());
    records::make(folder.path());
    let with = |cases: &'static [Case], more: &'static str| cases.iter().map(move |case| (case, more));
    let all = with(TABLES, " --dry-run").chain(with(BAGS, COARSE)).chain(with(POSES, NEEDLE)).chain(with(CHECKS, ""));
    let (mut table, mut wrong) = (String::new(), String::new());
    for (case, more) in all {
        let (code, text) = run(&format!("{}{more}", case.command), folder.path());
        assert!(!text.contains("panicked"), "{}: {text}", case.command);
        let first = text.lines().next().unwrap_or_default();
        writeln!(table, "| {} | {} | {code} | {first} |", case.row, case.command).unwrap();
        let said = |words: &str| words.strip_prefix('!').map_or(text.contains(words), |never| !text.contains(never));
        let missing: Vec<&&str> = case.says.iter().filter(|words| !said(words)).collect();
        if code != case.code || !missing.is_empty() {
            writeln!(wrong, "{}: exit code {code}, not {}; without {missing:?}:\n{text}", case.command, case.code)
                .unwrap();
        }
    }
    for (row, name, words) in FILES {
        let path = match name.strip_prefix("@/") {
            Some(made) => folder.path().join(made),
            None => Path::new(env!("CARGO_MANIFEST_DIR")).join(name),
        };
        let text = fs::read_to_string(&path).unwrap();
        writeln!(table, "| {row} | {name} | | has {words:?} |").unwrap();
        let missing: Vec<&&str> = words.iter().filter(|words| !text.contains(**words)).collect();
        if !missing.is_empty() {
            writeln!(wrong, "{name}: without {missing:?}").unwrap();
        }
    }
    let rows: BTreeSet<u8> = table.lines().filter_map(|line| line.split('|').nth(1)?.trim().parse().ok()).collect();
    println!("{table}");
    assert!(wrong.is_empty(), "{wrong}");
    assert_eq!(rows, (1..=24).collect(), "every row of the issue is run");
}

/// Row 10: five million rows in less memory than their numbers alone would take; run with one in 16 of them.
#[test]
fn a_long_table_streams() {
    const ROWS: u32 = 5_000_000;
    let folder = TempDir::new().unwrap();
    let mut file = BufWriter::new(File::create(folder.path().join("long.csv")).unwrap());
    writeln!(file, "Time (s),Depth (mm),Load (N)").unwrap();
    for i in 0..ROWS {
        writeln!(file, "{:.4},{:.6},{:.6}", f64::from(i) * 1e-4, f64::from(i) * 1e-6, f64::from(i % 1000) * 1e-6)
            .unwrap();
    }
    file.into_inner().unwrap();
    let run = |megabytes: u32, arguments: &str| {
        let begun = Instant::now();
        let limited = format!("ulimit -v {megabytes}000; RAYON_NUM_THREADS=1 exec \"$0\" {arguments}");
        let program = env!("CARGO_BIN_EXE_needle_twin");
        let output = Command::new("sh").current_dir(folder.path()).args(["-c", &limited, program]).output().unwrap();
        let (code, seconds) = (output.status.code(), begun.elapsed().as_secs_f64());
        println!("| 10 | {arguments} in {megabytes} MB | {code:?} | {seconds:.1} s |");
        (code, [output.stdout, output.stderr].map(|out| String::from_utf8_lossy(&out).into_owned()).concat())
    };
    let (code, text) = run(200, "import long.csv --out bag");
    assert!(code == Some(0) && text.contains("force  5000000 readings"), "{text}");
    // ten readings a stamp, and a hole
    let mut file = BufWriter::new(File::create(folder.path().join("coarse.csv")).unwrap());
    writeln!(file, "Time (s),Depth (mm),Load (N)").unwrap();
    for i in 0..3_000_000_u32 {
        let time = f64::from(i / 10) * 1e-3 + if i < 2_000_000 { 0.0 } else { 900.0 };
        writeln!(file, "{time:.3},{:.6},{:.6}", f64::from(i) * 1e-6, f64::from(i % 1000) * 1e-6).unwrap();
    }
    file.into_inner().unwrap();
    let (code, text) = run(200, "import coarse.csv --out coarse");
    let said = [
        "2700000 readings have the stamp of another",
        "3000000 readings",
        "to 1200.000 s",
        "(900.000 s) nothing was recorded",
    ];
    assert!(code == Some(3) && said.iter().all(|words| text.contains(words)), "{text}");
    let few = "replay long.csv --most-readings 400000 --scene compression --force --set discretisation.spacing_m=0.004";
    let (_, text) = run(400, few);
    assert!(text.contains("312500 answered") && text.contains("one in 16 of them is used"), "{text}");
}
