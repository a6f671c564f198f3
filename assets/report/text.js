// Numbers and names as text of a page.

/// A number with so many significant figures.
function figures(value, n) {
  if (!Number.isFinite(value)) return '–';
  const text = Math.abs(value) >= 10 ** n ? Math.round(value).toString() : Number(value.toPrecision(n)).toString();
  return minus(text);
}

/// A name as text of the page.
function escaped(name) { return name.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`); }

/// Parts of a read-out, none of which breaks in the middle.
function spans(parts) { return parts.map((part) => `<span>${part}</span>`).join(' · '); }
