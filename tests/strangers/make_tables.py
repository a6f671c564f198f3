# Workbooks and arrays of `tables/`, as openpyxl 3.1 and NumPy 2 write them: `python make_tables.py`.
import datetime as dt, numpy as np, openpyxl
from pathlib import Path
out = Path(__file__).parent / "tables"
i = np.arange(40)
t, d, f = i / 10, i * 0.02, i * 1e-4
book = openpyxl.Workbook()
notes = book.active; notes.title = "Notes"
notes["A1"] = "operator"; notes["B1"] = "A. B."; notes["A2"] = "gel"; notes["B2"] = 7
gel = book.create_sheet("Gel 7")
gel["B2"] = "Indentation of gel 7"
for c, name in zip("BCDE", ["Time", "Depth", "Load", "State"]): gel[c + "4"] = name
for c, unit in zip("BCD", ["s", "mm", "N"]): gel[c + "5"] = unit
for k in range(40):
    for c, v in zip("BCDE", [float(t[k]), float(d[k]), float(f[k]), "in"]): gel[f"{c}{k + 6}"] = v
other = book.create_sheet("Gel 8")
other.append(["Time (s)", "Depth (mm)", "Load (N)"])
for k in range(40): other.append([float(t[k]), float(d[k]), float(2 * f[k])])
book.save(out / "workbook.xlsx")
book = openpyxl.Workbook(); sheet = book.active
sheet.append(["Load (N)", "Timestamp", "Depth (mm)"])
for k in range(40):
    when = dt.datetime(2026, 3, 4, 23, 59, 58) + dt.timedelta(milliseconds=100 * k)
    sheet.append([float(f[k]) if k != 7 else "#DIV/0!", when, float(d[k])])
sheet.cell(9, 1).data_type = "e"
book.save(out / "dates_and_error.xlsx")
book = openpyxl.Workbook(); book.active.append(["nothing", "here"]); book.save(out / "no_table.xlsx")
np.savez_compressed(out / "arrays.npz", time_s=t, depth_mm=d.astype("f4"), force_n=f, rate_hz=10.0, operator=np.array(["A. B."]))
np.savez(out / "two_lengths.npz", t=t, z=d, tf=np.arange(80) / 20, f=np.arange(80) * 5e-5)
np.save(out / "array.npy", np.asfortranarray(np.column_stack([t, d, f])))
np.save(out / "transposed.npy", np.array([t, d, f]))
fields = np.zeros(40, dtype=[("stamp", "M8[ms]"), ("state", "U8"), ("depth_mm", ">f8"), ("force_n", "<f8")])
fields["stamp"] = np.datetime64("2026-03-04T10:15:00") + (100 * i).astype("m8[ms]")
fields["state"], fields["depth_mm"], fields["force_n"] = "in", d, f
np.save(out / "fields.npy", fields)
