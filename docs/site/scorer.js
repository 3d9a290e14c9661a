// Scores like Sphinx, but ranks written pages before the API pages and the changelog, which contain nearly every word.
var Scorer = {
  score: (result) => result[4] * (/^generated\/api\/|CHANGELOG/.test(result[0]) ? 0.2 : 1),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
