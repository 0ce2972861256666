// Numbers as the language of the page writes them: German 1.500 and English 1,500 are both one thousand five hundred.
const MOST_DIGITS = 6; // after the decimal mark: finer than any mass that the service keeps

function marks(language) {
  const parts = new Intl.NumberFormat(language, { useGrouping: "always" }).formatToParts(12345.6);
  const mark = (type) => parts.find((part) => part.type === type)?.value ?? "";
  return { group: mark("group"), decimal: mark("decimal") };
}

const literal = (text) => text.replace(/[.*+?^${}()|[\]\\]/g, "\\$&");

// Return the number that a person typed, or null where the text is empty or no number of that language. Digits may be
// grouped in threes, by the language's own mark or by a space; a mark anywhere else makes the text no number.
export function parseNumber(text, language) {
  const { group, decimal } = marks(language);
  const grouped = `\\d{1,3}(?<mark>${literal(group)}|\\s|['’])\\d{3}(?:\\k<mark>\\d{3})*`;
  const pattern = new RegExp(`^(?<sign>-?)(?<whole>${grouped}|\\d+)(?:${literal(decimal)}(?<fraction>\\d+))?$`);
  const found = pattern.exec(text.trim().replace("−", "-"))?.groups;
  if (!found) return null;
  return Number(`${found.sign}${found.whole.replace(/\D/g, "")}.${found.fraction ?? "0"}`);
}

// Return a number, without marks between its thousands, as text that parseNumber reads back to the same number.
export function formatNumber(value, language) {
  return new Intl.NumberFormat(language, { maximumFractionDigits: MOST_DIGITS, useGrouping: false }).format(value);
}
