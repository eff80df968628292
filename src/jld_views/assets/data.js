// @ts-check
/** The data of a page, out of the page. */
import { complaint } from "./contract.js";

/**
 * Base64 of gzip of JSON, in the element with the id `data`.
 * @returns {Promise<import("./contract.js").PageData>}
 */
export async function embedded() {
  const text = document.getElementById("data")?.textContent ?? "";
  const packed = Uint8Array.from(atob(text.trim()), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return checked(JSON.parse(await new Response(stream).text()));
}

/**
 * The data, if it is what the page was written for. Raises an error that says what is wrong.
 * @param {any} data
 * @returns {import("./contract.js").PageData}
 */
export function checked(data) {
  const wrong = complaint(data);
  if (wrong) throw new Error(wrong);
  return data;
}
