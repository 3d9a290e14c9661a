// Sphinx's scores, but pages that were written for readers come before the API, which has every word many times.
var Scorer = {
  score: (result) => result[4] * (result[0].startsWith("generated/api/") ? 0.2 : 1),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
